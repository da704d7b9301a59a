"""Gain of foresight against process noise: ``python -m agents.process_noise [NAME ...]``.

Plays KershawEvansPosition with Kalman filters of several process noise densities, and with an IMM of these densities,
in drawn worlds (``drawn``: the filter knows the density) and on recordings. The recording ``aircraft`` is in the
repository; the environment's own radar sees it at 165 to 210 km. ``--recording NAME FILE LATITUDE LONGITUDE ALTITUDE``
adds another one, seen within 40 km by a radar of shorter range. Results are written to results/process_noise, their
tables and picture to docs/process_noise.md. ``--tables`` renews the page without playing.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from agents import blocks
from agents.leaderboard import ROOT
from wavegym.core.arrays import Array
from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import check_choice
from wavegym.core.files import write_whole
from wavegym.core.worlds import word
from wavegym.evaluation import compare, make_task, statistics
from wavegym.evaluation.adapters import SAVED
from wavegym.evaluation.comparison import BASELINE, Comparison
from wavegym.evaluation.picture import as_png
from wavegym.evaluation.table import interval, number, signed, tabulated
from wavegym.policies.runs import load_policy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NAME = "KershawEvansPosition"
ENV_ID = f"wavegym/{NAME}-v0"
FOLDER, PAGE = ROOT / "results" / "process_noise", ROOT / "docs" / "process_noise.md"
START, END = "<!-- made by `python -m agents.process_noise`: -->", "<!-- process noise to here -->"
PICTURE = ROOT / "docs" / "images" / "process_noise.png"
DENSITIES = (0.1, 1.0, 10.0, 100.0, 1000.0)  # m^2/s^3
SCHEDULERS = "lookahead:2", "ppo", "best-fixed"
DRAWN = "drawn"
WORLDS, SEED = 400, 0
FAR = {"nearest_range": 165e3, "farthest_range": 210e3}  # m: where the environment's own targets are
# A radar of shorter range, m. Beyond ``farthest`` the variance of the farthest windows would dominate the mean.
NEAR = {"nearest_range": 100.0, "farthest_range": 40e3, "reference_range": 50e3}
SMOOTHING = 7.0  # s, with which the results were made
EXPECTED_NEES = 2.0
REGISTERED = 100.0  # m^2/s^3, the density of the registered environment
SIZES = "targets", "windows", "worlds"


class Recording(NamedTuple):
    """A file of tracks, and the place of the radar."""

    file: Path
    radar: tuple[float, float, float]  # latitude and longitude in degrees, altitude in m
    ranges: Mapping[str, float] = NEAR

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters of the system that play it."""
        return {
            "targets": "recorded",
            "tracks": self.file,
            "radar": self.radar,
            "smoothing": SMOOTHING,
            **self.ranges,
        }


AIRCRAFT = Recording(ROOT / "examples" / "data" / "aircraft_tracks.csv", (51.75, -1.25, 100.0), FAR)


def play(recording: Recording | None, worlds: int, jobs: int) -> dict[str, Any]:
    """All trackers in drawn worlds (None) or on a recording: costs, squared errors, NEES and gains."""
    agents = load_policy(SAVED / NAME / "ppo", ENV_ID, make_task(ENV_ID, {}).system)
    policies = {BASELINE: None, **dict.fromkeys(SCHEDULERS), "ppo": agents}
    found: dict[str, Any] = {"worlds": worlds, "cases": []}
    if recording:
        system: Any = make_task(ENV_ID, recording.parameters).system
        played = system.recorded_windows
        targets = {played.locate(i)[0].id for i in range(len(played))}
        found |= {"file": recording.file.name, "radar": recording.radar}
        found |= {"windows": len(played), "targets": len(targets)}
    for tracker, q in _trackers(drawn=recording is None):
        tracked_with = {"tracker": tracker, **({} if q is None else {"q": q})}
        parameters = {**tracked_with, **(recording.parameters if recording else {})}
        comparison = compare(ENV_ID, policies, worlds=worlds, seed=SEED, jobs=jobs, keep=FOLDER, **parameters)
        found["cases"].append({"tracker": tracker, "q": q, "policies": _figures(comparison)})
    return found


def _trackers(drawn: bool) -> Iterator[tuple[str, float | None]]:
    """Each tracker with its assumed density; in drawn worlds the IMM with the density of the world."""
    yield from (("kalman", q) for q in DENSITIES)
    yield from (("imm", q) for q in (DENSITIES if drawn else (None,)))


def _figures(comparison: Comparison) -> dict[str, Any]:
    """For each policy the means, and the differences to the one-step scheduler by belief and by truth, in per cent."""
    squares = {name: _squared_error(comparison, name) for name in comparison.played}
    figures = {}
    for name, members in comparison.played.items():
        rng = np.random.default_rng([SEED, word("bootstrap")])
        belief = statistics.difference(comparison.cost(name), comparison.cost(BASELINE), rng).percent
        truth = statistics.difference(squares[name], squares[BASELINE], rng).percent
        figures[name] = {
            "cost": float(comparison.cost(name).mean()),
            "squared_error": float(squares[name].mean()),
            "nees": float(np.mean([member.nees for member in members])),
            "belief": belief._asdict(),
            "truth": truth._asdict(),
        }
    return figures


def _squared_error(comparison: Comparison, name: str) -> Array:
    """Mean squared range error of each episode, (member, world), m^2."""
    return np.square([member.rmse for member in comparison.played[name]])


def table(found: Mapping[str, Any], drawn: bool) -> str:
    """A line for each tracker and policy in one set of worlds."""
    head = ["tracker", "policy", "RMS error m", "NEES", "belief %", "95 %", "truth %", "95 %"]
    rows = []
    for case in found["cases"]:
        for name, policy in case["policies"].items():
            row = [_tracker_name(case, drawn), name, number(_rms(policy)), f"{policy['nees']:.2f}"]
            for half in (policy["belief"], policy["truth"]):
                row += [signed(half["value"]), interval(half["ci"], signed)]
            rows.append(row)
    return tabulated(head, rows)


def _tracker_name(case: Mapping[str, Any], drawn: bool) -> str:
    if case["tracker"] == "kalman":
        return f"Kalman, q = {case['q']:g}"
    return f"IMM, world's q = {case['q']:g}" if drawn else "IMM"


def _rms(policy: Mapping[str, Any]) -> float:
    return float(np.sqrt(policy["squared_error"]))


def model_against_waveform(results: Mapping[str, Any]) -> str:
    """RMS errors on each recording: with the best waveform at the registered density, or with the best density."""
    given = f"q = {REGISTERED:g}: "
    head = ["recording", f"{given}myopic", f"{given}best", "best q: myopic", "IMM: myopic", "IMM: lookahead:2"]
    rows = []
    for name, found in results.items():
        if name == DRAWN:
            continue
        cases = [case for case in found["cases"] if case["tracker"] == "kalman"]
        registered = next(case["policies"] for case in cases if case["q"] == REGISTERED)
        waveform = min(registered, key=lambda policy: _rms(registered[policy]))
        model = min(cases, key=lambda case: _rms(case["policies"][BASELINE]))
        imm = found["cases"][-1]["policies"]
        rows.append(
            [
                name,
                number(_rms(registered[BASELINE])),
                f"{number(_rms(registered[waveform]))} ({waveform})",
                f"{number(_rms(model['policies'][BASELINE]))} (q = {model['q']:g})",
                number(_rms(imm[BASELINE])),
                number(_rms(imm["lookahead:2"])),
            ]
        )
    return tabulated(head, rows)


def sources(results: Mapping[str, Any]) -> str:
    """A line for each recording."""
    head = ["recording", "file", "radar", "targets", "windows", "worlds played"]
    rows = [
        [name, f"`{found['file']}`", _place(found["radar"]), *(str(found[key]) for key in SIZES)]
        for name, found in results.items()
        if name != DRAWN
    ]
    return tabulated(head, rows)


def _place(radar: Sequence[float]) -> str:
    latitude, longitude, altitude = radar
    return f"{latitude:g}°, {longitude:g}°, {altitude:g} m"


def picture(results: Mapping[str, Any]) -> bytes:
    """Gains by belief and by truth, NEES and RMS error against the density that the filter assumes, as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 * len(results) + 0.5, 9.0), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(4, len(results), sharex=True, sharey="row", squeeze=False)
    for column, (worlds, found) in zip(grid.T, results.items(), strict=True):
        column[0].set_title(worlds)
        column[3].set_xlabel("process noise density q [m²/s³]")
        for axes, half in zip(column[:2], ("belief", "truth"), strict=True):
            for name, colour in (("lookahead:2", "tab:blue"), ("ppo", "tab:green")):
                _draw(axes, found, name, colour, lambda policy, half=half: -policy[half]["value"])
            axes.axhline(0.0, color="0.6", linewidth=0.8)
        for name, colour in ((BASELINE, "tab:orange"), ("lookahead:2", "tab:blue")):
            _draw(column[2], found, name, colour, lambda policy: policy["nees"])
            _draw(column[3], found, name, colour, _rms)
        column[2].axhline(EXPECTED_NEES, color="0.6", linewidth=0.8)
        for axes, ticks in zip(column[2:], ((1, 2, 5, 10, 20, 50), (5, 7, 10, 14, 20)), strict=True):
            axes.set_yscale("log")
            axes.set_yticks(ticks, [str(tick) for tick in ticks])
            axes.minorticks_off()
        column[0].set_xscale("log")
    labels = ("gain by belief [%]", "gain by truth [%]", f"mean NEES (expected: {EXPECTED_NEES:g})", "RMS error [m]")
    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    handles = {line.get_label(): line for axes in grid[:, 0] for line in axes.get_lines() if line.get_label()[0] != "_"}
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3, fontsize="small")
    return as_png(figure)


def _draw(axes: Axes, found: Mapping[str, Any], policy: str, colour: str, value: Any) -> None:
    """One policy, if it was played: a line over the Kalman filters' densities; the IMM is dashed and level."""
    if policy not in found["cases"][0]["policies"]:
        return
    for tracker, label, style in (("kalman", "Kalman filter", "o-"), ("imm", "IMM", "--")):
        cases = [case for case in found["cases"] if case["tracker"] == tracker]
        densities = [case["q"] for case in cases] if cases[0]["q"] is not None else [DENSITIES[0], DENSITIES[-1]]
        values = np.array([value(case["policies"][policy]) for case in cases])
        shown = np.broadcast_to(values, len(densities))
        axes.plot(densities, shown, style, color=colour, markersize=3, label=f"{policy}, {label}")


def renew(folder: Path = FOLDER) -> None:
    """Renew the page and the picture from all results."""
    files = sorted(folder.glob("*.json"), key=lambda file: (file.stem != DRAWN, file.stem))
    results = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files}
    parts = [sources(results), model_against_waveform(results)]
    parts += [f"### {name.capitalize()}\n\n{table(found, name == DRAWN)}" for name, found in results.items()]
    blocks.renew(PAGE, START, END, "\n\n".join(parts))
    write_whole(PICTURE.parent, {PICTURE.name: picture(results)})


def _recordings(given: Sequence[Sequence[str]]) -> dict[str, Recording]:
    """The recording of the repository, and those of the command line."""
    parsed = {name: Recording(Path(file), (float(a), float(b), float(c))) for name, file, a, b, c in given}
    return {"aircraft": AIRCRAFT, **parsed}


def main() -> None:
    """The command."""
    parser = Parser(prog="python -m agents.process_noise", description="Gain of foresight against process noise.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="drawn, aircraft or a --recording (default: all)")
    parser.add_argument(
        "--recording",
        nargs=5,
        action="append",
        default=[],
        metavar=("NAME", "FILE", "LATITUDE", "LONGITUDE", "ALTITUDE"),
        help="another recording, and where the radar stands (degrees, m)",
    )
    parser.add_argument("--worlds", type=int, default=WORLDS, help=f"worlds of each set (default: {WORLDS})")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--tables", action="store_true", help="renew the page from earlier results; play nothing")
    read = parser.read(None)
    sets: dict[str, Recording | None] = {DRAWN: None, **_recordings(read.recording)}
    for name in () if read.tables else read.names or sets:
        found = play(sets[check_choice("name", name, sets)], read.worlds, read.jobs)
        write_whole(FOLDER, {f"{name}.json": (json.dumps(found, indent=2) + "\n").encode()})
    renew()


if __name__ == "__main__":
    sys.exit(guarded(main))
