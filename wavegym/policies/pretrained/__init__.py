"""Trained agents that come with the package: training seed 0 of PPO and DQN in each environment that has them.

``ENVIRONMENT/ALGORITHM/`` holds policy.npz and run.json of the first training seed. ``python -m agents.package`` moves
them here from results/runs, where a link stays.
"""

from __future__ import annotations

from pathlib import Path

from wavegym.core.errors import InputError, check_choice, nearest
from wavegym.core.policy import Policy
from wavegym.core.system import System
from wavegym.policies.records import read_run
from wavegym.policies.runs import POLICY, RUN, load_policy
from wavegym.registration import stem

FOLDER = Path(__file__).parent
ALGORITHMS = ("ppo", "dqn")
FILES = (POLICY, RUN)


def pretrained_folder(env_id: str, algo: str) -> Path | None:
    """The folder of the agent that comes with an environment, for ``load_policy``; None if there is none.

    Args:
        env_id: the full id.
        algo: "ppo" or "dqn".
    """
    folder = FOLDER / stem(env_id) / algo
    if algo not in ALGORITHMS or not (folder / RUN).is_file() or read_run(folder / RUN)["env"] != env_id:
        return None
    return folder


def load_pretrained(env_id: str, algo: str, system: System) -> Policy:
    """The agent that comes with an environment.

    Raises:
        InputError: no such agent, or one that does not fit ``system``.
    """
    check_choice("agent", algo, ALGORITHMS)
    folder = pretrained_folder(env_id, algo)
    if folder is None:
        known = sorted({read_run(path)["env"] for path in FOLDER.glob(f"*/*/{RUN}")})
        wanted = f"expected one of {', '.join(map(repr, known))}{nearest(env_id, known)}"
        raise InputError(f"environment is {env_id!r}, which comes without a trained agent, {wanted}")
    (policy,) = load_policy(folder, env_id, system)
    return policy
