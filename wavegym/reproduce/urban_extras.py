"""What the street's ``summary.json`` says beyond the paper."""

from __future__ import annotations

from typing import Any

from wavegym.reproduce.claims import EXTRA, Finding, side
from wavegym.reproduce.urban import CLOSED, LONG, LOOSE, MYOPIC, NCV, NCV1, OPEN, RANDOM, SETTINGS, SHORT, TURNS, VSIMM
from wavegym.reproduce.urban_models import BRAKING
from wavegym.reproduce.urban_words import both, change, figures, origins, phase_of
from wavegym.reproduce.words import compared, mean, percent, share

ALIKE = 0.05  # the numbers of confirmed tracks are alike if they differ by less
ALWAYS = 0.99  # of the scans


def _one_model(summary: dict[str, Any]) -> Finding:
    loop = (NCV1, TURNS)
    over = {setting: figures(summary, setting, loop)["over_closed"] for setting in SETTINGS}
    enough = all(
        side(of["rmse"]["ci"], 1.0) in ("below", "around") and abs(of["confirmed"]["ratio"] - 1.0) < ALIKE
        for of in over.values()
    )

    why = " What fails in the baseline is one setting of its filter." if enough else ""

    def told(setting: str) -> str:
        return f"{compared(over[setting]['confirmed'])} and {compared(over[setting]['rmse'])}"

    def against_open(setting: str) -> str:
        return change(figures(summary, setting, loop)["over_open"]["rmse"])

    return EXTRA, (
        f"**One model that expects 1 m/s² in place of .25 is {'' if enough else 'not '}enough, in an open loop.** "
        f"Round robin with it has so many times the closed loop's confirmed tracks and error: {both(told)}. Against "
        f"the paper's open loop its error is, {both(against_open)}.{why}"
    )


def _long(summary: dict[str, Any]) -> Finding:
    closed = {setting: figures(summary, setting, CLOSED) for setting in SETTINGS}
    always = all(of["long"]["mean"] is not None and of["long"]["mean"] >= ALWAYS for of in closed.values())

    def told(setting: str) -> str:
        over = figures(summary, setting, (VSIMM, LONG))["over_closed"]
        return f"{compared(over['confirmed'])} and {compared(over['rmse'])}"

    return EXTRA, (
        f"**Myopic is {'always' if always else 'not always'} the long pulse.** It sends it in so many of the scans at "
        f"which there is a track: {both(lambda setting: share(closed[setting]['long']))}. Without a track all pulses "
        "cost the same, and it sends the first, a short one. To send nothing but the long pulse gives so many times "
        f"the closed loop's confirmed tracks and error: {both(told)}."
    )


def _scheduling(summary: dict[str, Any]) -> Finding:
    def over(setting: str, policy: str) -> dict[str, Any]:
        found: dict[str, Any] = figures(summary, setting, (VSIMM, policy))["over_closed"]
        return found

    def told(setting: str) -> str:
        return ", ".join(
            f"{name} {compared(over(setting, policy)['confirmed'])} and {compared(over(setting, policy)['rmse'])}"
            for policy, name in ((TURNS, "round robin"), (RANDOM, "random"), (SHORT, "always the short pulse"))
        )

    def without(setting: str) -> str:
        return compared(figures(summary, setting, (NCV, MYOPIC))["over_closed"]["rmse"])

    dearer = [setting for setting in SETTINGS if side(over(setting, TURNS)["rmse"]["ci"], 1.0) == "above"]
    only = "" if len(dearer) == len(SETTINGS) else f" with {''.join(dearer)} starts only"
    worth = f"some of the error{only}" if dearer else "nothing that can be told"
    return EXTRA, (
        f"**With the four models, scheduling is worth {worth}.** Confirmed "
        f"tracks and error over the closed loop's: {both(told)}. Judged by the error of round robin. Beside it, myopic "
        f"without the four models has so many times the closed loop's error: {both(without)}."
    )


def _starts(summary: dict[str, Any]) -> Finding:
    first, *_, last = summary["starts"]
    one, other = (of["over_open"]["confirmed"]["ci"] for of in (first, last))
    matters = one is not None and other is not None and (one[0] > other[1] or one[1] < other[0])

    why = " With loose starts the open loop soon replaces what it has lost, rightly or not." if matters else ""

    def told(key: str) -> str:
        return ", ".join(f"{change(of['over_open'][key])} at {of['vaguest']:g} m" for of in summary["starts"])

    return EXTRA, (
        f"**How many more tracks are confirmed {'is' if matters else 'is not'} a matter of how tracks begin.** The "
        "closed loop's number over the open loop's, by how well the place of a new track must be known: "
        f"{told('confirmed')}. Its error: {told('rmse')}. Its share of the targets' scans that are held: "
        f"{told('held')}.{why}"
    )


def _held(summary: dict[str, Any]) -> Finding:
    def told(setting: str) -> str:
        closed, opened = (figures(summary, setting, loop) for loop in (CLOSED, OPEN))
        return (
            f"{share(closed['held'])} against {share(opened['held'])}, {change(closed['over_open']['held'])}, and lose "
            f"a target {mean(closed['losses'], 2)} against {mean(opened['losses'], 2)} times in a run"
        )

    return EXTRA, (
        "**The number of confirmed tracks says little of what is held.** It counts tracks that follow nothing. Of the "
        f"targets' scans, of which {percent(summary['seen'])} % are seen straight by both receivers, the closed and "
        f"the open loop hold, {both(told)}."
    )


def _origins(summary: dict[str, Any]) -> Finding:
    def told(setting: str) -> str:
        closed, opened = (figures(summary, setting, loop)["false_tracks"] for loop in (CLOSED, OPEN))
        return f"{origins(closed)} in the closed loop, {origins(opened)} in the open one"

    return EXTRA, (
        f"**What false confirmed tracks are made of.** In a run, with ghost logic, {both(told)}. *Strayed*: a target's "
        "when it was confirmed. *Mirror*: at the mirror image of a target's place in the line of the antennas. "
        "*Walls*: of returns by walls, or of two targets. *Other*: of clutter, or of several of these."
    )


def _braking(summary: dict[str, Any]) -> Finding:
    of = {setting: phase_of(summary, setting, BRAKING) for setting in SETTINGS}

    def told(setting: str) -> str:
        means = of[setting]["mean"]
        return f"NCA {mean(means['NCA'], 2)}, CT left {mean(means['CT left'], 2)}"

    unknown = all(found["known_from"] is None for found in of.values())
    return EXTRA, (
        f"**Braking {'cannot be told from' if unknown else 'is told from'} the coming turn.** At scans "
        f"{of[LOOSE]['first']} to {of[LOOSE]['last']} target 1's track has, {both(told)}."
    )


EXTRAS = (_one_model, _long, _scheduling, _starts, _held, _origins, _braking)
