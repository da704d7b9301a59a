"""wavegym on Ray: environments for RLlib, and evaluation on a cluster. Needs ``pip install 'wavegym[ray]'``.

import wavegym.integrations.ray

wavegym.integrations.ray.register_envs()  # RLlib's workers then know every id
"""

from __future__ import annotations

from wavegym.core.work import cluster
from wavegym.integrations.ray.rllib import register_envs

__all__ = ["cluster", "register_envs"]
