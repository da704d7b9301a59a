"""Files from strangers: ``python -m research.promises.fuzz [--examples N] [KIND ...]``.

Policies, records of runs, recordings, scenarios, maps and the names in a report are changed at random. For any content
the suite must give a result or an error of one line (InputError), never another exception, and take less than 1 GB.
"""

from __future__ import annotations

import hashlib
import html.parser
import json
import resource
import sys
import tempfile
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from wavegym.core.command_line import Parser, guarded
from wavegym.core.errors import InputError, check_choice
from wavegym.core.files import pack_arrays, unpack_arrays
from wavegym.envs.scenario import scenario_differences, scenario_toml
from wavegym.evaluation import compare, make_task
from wavegym.evaluation.page import page
from wavegym.evaluation.summary import summarise
from wavegym.policies.runs import POLICY, PRETRAINED, RUN, load_policy
from wavegym.registration import SYSTEMS
from wavegym.sensors.urban_map import MAPS, UrbanMap
from wavegym.targets.reader import read_tracks

EXAMPLES = 10_000
PORTION = 500  # files for each run of Hypothesis, which otherwise keeps the text of up to 10 000 policies
MOST_MEMORY = 1 << 30  # bytes
WORDS = [
    b"nan", b"inf", b"-1", b"1e400", b"0", b"", b",", b"\n", b"\r", b"\x00", b'"', b"'", b"[", b"]", b"{", b"}", b"=",
    b"9" * 30, b"true", b"\xff\xfe", b"<script>", b"__import__('os')", b"#", b".", b"e", b"\xe2\x80\xa8",
]  # fmt: skip
TEXT = st.text(max_size=20) | st.sampled_from(["__DATA__", "__TITLE__", "</script>", "<img src=x onerror=alert(1)>"])
PLAIN = (
    st.none()
    | st.booleans()
    | st.integers(-(10**20), 10**20)
    | st.floats()
    | TEXT
    | st.lists(st.integers(-5, 5), max_size=4)
    | st.dictionaries(TEXT, st.integers(), max_size=2)
)


@st.composite
def edited(draw: st.DrawFn, content: bytes) -> bytes:
    """A file with some places replaced by troublesome words, or cut off."""
    for _ in range(draw(st.integers(1, 6))):
        start = draw(st.integers(0, len(content)))
        end = start + draw(st.integers(0, 8) | st.integers(0, len(content)))
        content = content[:start] + draw(st.sampled_from(WORDS) | st.binary(max_size=6)) + content[end:]
    return content


@st.composite
def changed_record(draw: st.DrawFn, record: Any) -> Any:
    """A JSON value with one to four entries replaced or dropped, however deep."""
    record = json.loads(json.dumps(record))
    for _ in range(draw(st.integers(1, 4))):
        at = record
        while True:
            keys = list(at) if isinstance(at, dict) else list(range(len(at)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            if isinstance(at[key], (dict, list)) and at[key] and draw(st.booleans()):
                at = at[key]
                continue
            if draw(st.integers(0, 4)) == 0:
                del at[key]
            else:
                at[key] = draw(PLAIN)
            break
    return record


@st.composite
def changed_arrays(draw: st.DrawFn, content: bytes) -> bytes:
    """A policy file with arrays dropped, reshaped, of other types or with other numbers."""
    arrays = unpack_arrays(content)
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(arrays)))
        array = np.array(arrays[name])
        how = draw(st.integers(0, 5))
        if how == 0 and len(arrays) > 1:
            del arrays[name]
        elif how == 1:
            arrays[name] = array.reshape(-1)
        elif how == 2 and array.dtype.kind != "U":
            arrays[name] = array.astype(draw(st.sampled_from(["f2", "f8", "i1", "i8", "U5", "c8", "?"])))
        elif how == 3 and array.size and array.dtype.kind in "fi":
            whole = st.integers(-(2**31), 2**31 - 1)
            number = draw(whole if array.dtype.kind == "i" else st.floats(width=32))
            with np.errstate(invalid="ignore"):
                array.reshape(-1)[draw(st.integers(0, array.size - 1))] = number
            arrays[name] = array
        elif how == 4:
            arrays[name] = np.zeros(draw(st.lists(st.integers(0, 40), max_size=4)), draw(st.sampled_from(["f4", "i8"])))
        else:
            arrays[draw(st.sampled_from([*arrays, "round9", "own_bias", "W7"]))] = array
    return pack_arrays(arrays)


@cache
def agents() -> list[Path]:
    """The folders of the agents in the package."""
    return sorted(file.parent for file in PRETRAINED.glob(f"*/*/{RUN}"))


def policies(draw: Callable[[Any], Any], folder: Path) -> None:
    """The folder of a run: a changed policy with the right checksum, or a changed record."""
    source = draw(st.sampled_from(agents()))
    content, record = (source / POLICY).read_bytes(), json.loads((source / RUN).read_text())
    how = draw(st.integers(0, 2))
    if how < 2:
        content = draw((edited if how else changed_arrays)(content))
        record["policy_sha256"] = hashlib.sha256(content).hexdigest()
    else:
        record = draw(changed_record(record))
    (folder / POLICY).write_bytes(content)
    (folder / RUN).write_text(json.dumps(record))
    env_id, own = task_of(source)
    (policy,) = load_policy(folder, env_id, own)
    policy.begin(own, 1, np.random.default_rng(0))


@cache
def task_of(folder: Path) -> tuple[str, Any]:
    """The id and the system that an agent was trained for."""
    record = json.loads((folder / RUN).read_text())
    return record["env"], make_task(record["env"], record["settings"]["environment"]).system


def tracks(draw: Callable[[Any], Any], folder: Path) -> None:
    """A recording in CSV."""
    (folder / "tracks.csv").write_bytes(draw(edited(recording())))
    read_tracks(folder / "tracks.csv")


@cache
def recording() -> bytes:
    """The first reports of the recorded aircraft."""
    lines = (Path(__file__).parents[2] / "examples" / "data" / "aircraft_tracks.csv").read_bytes().splitlines(True)
    return b"".join(lines[:60])


def scenarios(draw: Callable[[Any], Any], folder: Path) -> None:
    """A scenario in TOML, and the system that it makes."""
    env_id = draw(st.sampled_from(sorted(SYSTEMS)))
    (folder / "scenario.toml").write_bytes(draw(edited(scenario(env_id))))
    scenario_differences(env_id, folder / "scenario.toml")


@cache
def scenario(env_id: str) -> bytes:
    """The scenario of an environment at its defaults."""
    return scenario_toml(env_id).encode()


def cities(draw: Callable[[Any], Any], folder: Path) -> None:
    """An urban map in TOML."""
    (folder / "city.toml").write_bytes(draw(edited(draw(st.sampled_from(maps())))))
    UrbanMap.load(folder / "city.toml")


@cache
def maps() -> list[bytes]:
    """The maps of the suite."""
    return [file.read_bytes() for file in sorted(MAPS.glob("*.toml"))]


def reports(draw: Callable[[Any], Any], folder: Path) -> None:
    """The HTML report of a comparison with any names: no name becomes markup."""
    comparison, summary = compared()
    text = page(comparison, {**summary, "parameters": draw(st.dictionaries(TEXT, TEXT, max_size=3))}).decode()
    seen = Tags()
    seen.feed(text)
    if seen.found != plain_tags():
        raise AssertionError(f"the report has the tags {seen.found}, expected {plain_tags()}")


class Tags(html.parser.HTMLParser):
    """Counts tags."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        """One more."""
        self.found[tag] = self.found.get(tag, 0) + 1


@cache
def compared() -> tuple[Any, dict[str, Any]]:
    """A small comparison and its summary."""
    comparison = compare(
        "wavegym/KershawEvansPosition-v0", {"myopic": None}, worlds=3, jobs=1, progress=False, horizon=4
    )
    return comparison, summarise(comparison)


@cache
def plain_tags() -> dict[str, int]:
    """The tags of a report without settings."""
    seen = Tags()
    seen.feed(page(*compared()).decode())
    return seen.found


KINDS: dict[str, Callable[[Callable[[Any], Any], Path], None]] = {
    "policies": policies,
    "tracks": tracks,
    "scenarios": scenarios,
    "cities": cities,
    "reports": reports,
}


def fuzz(kind: str, examples: int) -> tuple[int, int]:
    """The numbers of accepted and refused files. Raises any other exception that the suite raises for a file."""
    counted = {"accepted": 0, "refused": 0}
    with tempfile.TemporaryDirectory() as name:
        for done in range(0, examples, PORTION):

            @seed(done)
            @settings(
                max_examples=min(PORTION, examples - done), deadline=None, database=None, report_multiple_bugs=False,
                suppress_health_check=list(HealthCheck), phases=[Phase.generate, Phase.shrink],
            )  # fmt: skip
            @given(st.data())
            def one(data: st.DataObject) -> None:
                counted[answer(kind, data, Path(name))] += 1

            one()
    return counted["accepted"], counted["refused"]


def answer(kind: str, data: st.DataObject, folder: Path) -> str:
    """The result of one file: "accepted" or "refused"."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            KINDS[kind](data.draw, folder)
    except InputError as error:
        if "\n" in str(error):
            raise AssertionError(f"an error of several lines: {error}") from error
        return "refused"
    return "accepted"


def main() -> None:
    """Print a line for each kind of file."""
    parser = Parser(prog="python -m research.promises.fuzz", description="Files that are changed at random.")
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"which of {', '.join(KINDS)} (default: all)")
    parser.add_argument("--examples", type=int, default=EXAMPLES, help=f"files of each kind (default: {EXAMPLES})")
    read = parser.read(None)
    for kind in read.kinds or KINDS:
        check_choice("kind", kind, KINDS)
        before = peak()
        accepted, refused = fuzz(kind, read.examples)
        more = peak() - before
        print(
            f"{kind}: {accepted} accepted, {refused} refused in one line, {more / 2**20:.0f} MiB more memory",
            flush=True,
        )
        if more > MOST_MEMORY:
            raise InputError(f"{kind} took {more} bytes more, expected at most {MOST_MEMORY}")


def peak() -> int:
    """The most memory that this process has taken so far, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


if __name__ == "__main__":
    sys.exit(guarded(main))
