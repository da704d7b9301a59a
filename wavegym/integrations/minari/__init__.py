"""Episodes of any policy as a Minari dataset, for offline learning. Needs ``pip install 'wavegym[minari]'``.

>>> from wavegym.integrations.minari import collect, load
>>> dataset = collect("KershawEvans-v0", "myopic", episodes=4, out=folder)
>>> dataset.total_steps
200
>>> load(folder, dataset.id).total_episodes
4
"""

from __future__ import annotations

from wavegym.core.errors import InputError

try:
    from wavegym.integrations.minari.collect import collect, load, stored_in
except ImportError as error:
    raise InputError(f"datasets need the extra: {error}; pip install 'wavegym[minari]'") from None

__all__ = ["collect", "load", "stored_in"]
