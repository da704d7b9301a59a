"""The subcommands ``evaluate``, which compares policies, and ``submit``, which plays a submission to the board."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wavegym.cli.environments import environment_parser, read_environment
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError
from wavegym.core.registry import import_package
from wavegym.core.work import add_worker_options, workers

POLICIES = """comma-separated names, which wavegym policies ENV lists and explains; the folder of a trained run (or of
several runs, one for each seed); an ONNX file (FILE.onnx), as of wavegym export; with --trust, a model saved by
Stable-Baselines3 (FILE.zip) or package.module:factory"""

RECORDED = "KershawEvansPosition-v0"

# Arguments of `compare` that are no parameters of an environment, and their options.
COMPARISON = {
    "env_id": "it as the first argument",
    "policies": "--policies NAMES",
    "worlds": "--worlds N",
    "until": "--until PERCENT",
    "by": "--by belief or --by truth",
    "seed": "--seed S",
    "jobs": "--jobs J",
    "trust": "--trust",
    "progress": "none: the bar shows on a terminal only",
    "keep": "none: results are kept in --out",
}


def parser() -> Parser:
    """The options."""
    options = environment_parser("evaluate", "Compare policies on the same worlds.")
    options.add_argument("--policies", default="myopic,best-fixed,random", help=f"{POLICIES} (default: %(default)s)")
    options.add_argument(
        "--worlds", type=int, default=200, metavar="N", help="number of test worlds (default: %(default)s)"
    )
    until = (
        "play further worlds until the 95 %% interval of every policy against myopic is at most this many per cent "
        "wide on either side, or 5000 are played"
    )
    options.add_argument("--until", type=float, metavar="PERCENT", help=until)
    options.add_argument(
        "--by",
        default="belief",
        help="interval of --until: of the cost by belief, or of the error by truth (default: %(default)s)",
    )
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    options.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the test worlds (default: 0)")
    add_worker_options(options)
    options.add_argument("--tracks", type=Path, metavar="FILE.csv", help="recorded targets")
    options.add_argument(
        "--radar",
        type=float,
        nargs="+",
        metavar="X",
        help="position of the radar: LAT LON [ALT], or X Y [Z] in metres",
    )
    paths = (
        "also write the true, estimated and measured paths of the first N worlds (trajectories.csv, measurements.csv)"
    )
    options.add_argument("--trajectories", type=int, metavar="N", help=paths)
    options.add_argument(
        "--trust", action="store_true", help="run the code in the .zip files and modules among the policies"
    )
    options.add_argument(
        "--import",
        action="append",
        default=[],
        dest="packages",
        metavar="PACKAGE",
        help="import a package that registers environments, schedulers or chirp laws; may be repeated",
    )
    return options


def task(options: Any) -> tuple[str, dict[str, Any]]:
    """The full id and the system's parameters. InputError if the system takes no recorded targets."""
    from wavegym.core.traits import RecordedTargets, lacks_trait
    from wavegym.evaluation import make_task

    env_id, chosen = read_environment(options.env, options.set)
    for name in chosen:
        if name in COMPARISON:
            raise InputError(f"--set {name} is no parameter of an environment, expected {COMPARISON[name]}")
    if options.tracks:
        system: Any = make_task(env_id, {}).system
        if lacks_trait(system, RecordedTargets):
            refused = f"--tracks {options.tracks}: {env_id} takes no recorded targets"
            raise InputError(f"{refused} (nearest: {RECORDED}, which does)")
        chosen["tracks"] = options.tracks
        if isinstance(system.targets, str):  # otherwise the number of targets
            chosen["targets"] = "recorded"
    if options.radar:
        if len(options.radar) not in (2, 3):
            raise InputError(f"--radar has {len(options.radar)} numbers, expected LAT LON or LAT LON ALT")
        chosen["radar"] = (*options.radar, 0.0)[:3]
    return env_id, chosen


def policies(names: str) -> dict[str, Any]:
    """The policies for ``compare``: None for a known name, a Path for a folder or a file.

    Raises:
        InputError: two policies of one name, or none at all.
    """
    from wavegym.evaluation.adapters import is_folder
    from wavegym.schedulers.registry import is_scheduler

    found: dict[str, Any] = {}
    for name in filter(None, (part.strip() for part in names.split(","))):
        key, source = name, None
        is_file = name.endswith((".zip", ".onnx"))
        if not is_scheduler(name) and (is_file or is_folder(name)):
            source = Path(name)
            key = source.stem if is_file else source.resolve().name
        if key in found:
            raise InputError(f"two policies are called {key!r}, expected different names (rename a folder)")
        found[key] = source
    if not found:
        raise InputError(f"--policies is {names!r}, expected at least one name, such as myopic")
    return found


def evaluate(arguments: Sequence[str] | None) -> None:
    """Play, compare, write, print."""
    options = parser().read(arguments)
    # These imports take half a second; a misspelt option is reported before them.
    from wavegym.evaluation import compare, write_report

    for package in options.packages:
        import_package(package)
    env_id, parameters = task(options)
    options.out.mkdir(parents=True, exist_ok=True)
    chosen = policies(options.policies)
    common: dict[str, Any] = {"worlds": options.worlds, "seed": options.seed, "trust": options.trust}
    files = ["report.html", "summary.json", "episodes.csv", "table.md", "comparison.png"]
    if options.trajectories is not None:
        from wavegym.evaluation.trajectories import write_trajectories

        files += write_trajectories(options.out, env_id, chosen, options.trajectories, **common, **parameters)
    with workers(options):
        width = {"until": options.until, "by": options.by}
        comparison = compare(env_id, chosen, jobs=options.jobs, keep=options.out, **width, **common, **parameters)
    print(write_report(comparison, options.out))
    print(f"\nwritten to {options.out}: {', '.join(files)}")


def submit_parser() -> Parser:
    """The options of ``submit``."""
    options = Parser(prog="wavegym submit", description="Play a submission to the board against best-simple.")
    options.add_argument("folder", type=Path, metavar="FOLDER", help="folder with submission.toml and policies")
    options.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the record, NAME.json")
    options.add_argument(
        "--worlds", type=int, default=100, metavar="N", help="worlds of each environment (default: 100)"
    )
    seed = "seed of the test worlds (default: 0; the board draws its own at each release)"
    options.add_argument("--seed", type=int, default=0, metavar="S", help=seed)
    add_worker_options(options)
    return options


def submit(arguments: Sequence[str]) -> None:
    """Play, write the record, print the table."""
    options = submit_parser().read(arguments)
    from wavegym.evaluation.submission import play_submission, read_record, read_submission, table

    submission = read_submission(options.folder)
    with workers(options):
        for env_id in play_submission(
            submission, options.out, seed=options.seed, worlds=options.worlds, jobs=options.jobs
        ):
            print(f"played {env_id}", flush=True)
    file = options.out / f"{submission.name}.json"
    print(f"\n{table(read_record(file))}\n\nwritten to {file}")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its exit status."""
    return guarded(lambda: evaluate(arguments))
