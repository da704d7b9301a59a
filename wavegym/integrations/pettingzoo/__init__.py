"""Several agents: PettingZoo's parallel environments of every system with several decision makers.

>>> from wavegym.integrations.pettingzoo import parallel_env
>>> env = parallel_env("AgileClutter-v0", sees="own")
>>> observations, infos = env.reset(seed=0)
>>> env.agents
['sensor_1', 'sensor_2']
>>> actions = {agent: env.action_space(agent).sample() for agent in env.agents}
>>> observations, rewards, terminations, truncations, infos = env.step(actions)
>>> rewards["sensor_1"] == rewards["sensor_2"] == -infos["sensor_1"]["cost"]
True

``BatchedParallelEnv`` steps many worlds at once. ``TeamPolicy`` makes one policy of the agents' policies, which
``wavegym.evaluation.compare`` plays against schedulers. Needs the extra ``pettingzoo``.
"""

from __future__ import annotations

from wavegym.core.errors import InputError

try:
    import pettingzoo  # noqa: F401
except ImportError as error:
    raise InputError(f"several agents need the extra: {error}; pip install 'wavegym[pettingzoo]'") from None

from wavegym.integrations.pettingzoo.parallel import BatchedParallelEnv, WaveformParallelEnv, parallel_env
from wavegym.integrations.pettingzoo.team import TeamPolicy
from wavegym.integrations.pettingzoo.views import AgentViews

__all__ = ["AgentViews", "BatchedParallelEnv", "TeamPolicy", "WaveformParallelEnv", "parallel_env"]
