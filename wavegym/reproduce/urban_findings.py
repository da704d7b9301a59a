"""What the street's ``summary.json`` says of the paper's claims: the numbers decide which of them hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from wavegym.reproduce.claims import HOLDS, NOT, PART, Finding, Teller, listed, side
from wavegym.reproduce.urban import CLOSED, LOOSE, MYOPIC, NCV, OPEN, SETTINGS, TURNS, VSIMM
from wavegym.reproduce.urban_extras import EXTRAS
from wavegym.reproduce.urban_models import LIMIT, ON, SPEEDING, TURN
from wavegym.reproduce.urban_words import both, change, figures, metres, percents, phase_of
from wavegym.reproduce.words import mean, ratio

MORE, LESS = (10.0, 15.0), (55.0, 65.0)  # per cent; the paper: about 15 % more confirmed tracks, about 60 % less error
FALSE = 0.3  # different false confirmed tracks in a run
KEEPS = 0.99  # of what is held, ghost logic is to leave at least this share


def findings(summary: dict[str, Any]) -> str:
    """Markdown: what of the paper holds, in part, or not, and what it does not ask."""
    claims = (_more, _less, _knows(TURN), _knows(SPEEDING), _knows(ON), _false, _emergent, *EXTRAS)
    return listed(summary, claims)


def _gain(summary: dict[str, Any], key: str, tell: Callable[[dict[str, Any]], str]) -> tuple[str, str]:
    """Of one figure, the closed loop against the open one in either setting; and without ghost logic."""

    def told(setting: str) -> str:
        closed, opened = (tell(figures(summary, setting, loop)[key]) for loop in (CLOSED, OPEN))
        return f"{over(setting)}: {closed} against {opened}"

    def over(setting: str, ghosts: bool = True) -> str:
        return change(figures(summary, setting, CLOSED, ghosts)["over_open"][key])

    return both(told), both(lambda setting: over(setting, False))


def _more(summary: dict[str, Any]) -> Finding:
    told, without = _gain(summary, "confirmed", lambda found: mean(found, 2))
    heading, said = _within(percents(figures(summary, LOOSE, CLOSED)["over_open"]["confirmed"]), MORE)
    return heading, (
        f"**Confirmed tracks: {said}.** The paper's closed loop has about 15 % more than its open one. Ours has, "
        f"{told}. Without ghost logic: {without}. Judged by loose starts, on "
        f"which {MORE[0]:g} to {MORE[1]:g} % were expected. The number counts false tracks too."
    )


def _less(summary: dict[str, Any]) -> Finding:
    told, without = _gain(summary, "rmse", metres)
    heading, said = _within(percents(figures(summary, LOOSE, CLOSED)["over_open"]["rmse"], -1.0), LESS)
    return heading, (
        f"**Position error: {said}.** The paper's closed loop has about 60 % less RMS error. Ours has, on the targets "
        f"held, {told}. Without ghost logic: {without}. Judged by loose "
        f"starts, on which {LESS[0]:g} to {LESS[1]:g} % were expected."
    )


def _within(found: Sequence[float] | None, wanted: tuple[float, float]) -> tuple[str, str]:
    """The heading, and what is said of an improvement in percent, [low, high], that was to be between two numbers."""
    where = side(found, 0.0)
    if found is None or where != "above":
        return NOT, "the closed loop is worse" if where == "below" else "no difference can be told"
    if found[0] <= wanted[1] and found[1] >= wanted[0]:
        return HOLDS, "better by as much as in the paper"
    return PART, f"better, by {'more' if found[0] > wanted[1] else 'less'} than in the paper"


def _knows(phase: str) -> Teller:
    """Whether the closed loop knows how the first target moves in a phase."""

    def finding(summary: dict[str, Any]) -> Finding:
        of = {setting: phase_of(summary, setting, phase) for setting in SETTINGS}
        first, model = of[LOOSE]["first"], of[LOOSE]["expected"]
        throughout = all(side(found["least"]["ci"], LIMIT) == "above" for found in of.values())
        mostly = all(side(found["mean"][model]["ci"], LIMIT) == "above" for found in of.values())
        soon = all(found["known_from"] is not None and found["known_from"] <= first for found in of.values())
        heading = HOLDS if throughout else PART if mostly else NOT
        said = "known" if throughout else "known on average, not surely at every scan" if soon else "known, but later"

        def told(setting: str) -> str:
            found = of[setting]
            since = found["known_from"]
            known = "at no scan for good" if since is None else f"from scan {since} on"
            return (
                f"{mean(found['mean'][model], 2)} on average, at least {mean(found['least'], 2)}, at scan "
                f"{found['least']['scan']}, and above {LIMIT:g} {known}"
            )

        return heading, (
            f"**Target 1, {phase}: {model} is {said if mostly else 'not known'}.** Its probability, a mean over runs, "
            f"was to be above {LIMIT:g} at every scan from {first} to {of[LOOSE]['last']}. It is, {both(told)}."
        )

    return finding


def _false(summary: dict[str, Any]) -> Finding:
    closed = {s: [figures(summary, s, CLOSED, on)["false_tracks"] for on in (True, False)] for s in SETTINGS}
    ghosts = {setting: summary["settings"][setting]["ghosts_over_none"]["closed"] for setting in SETTINGS}
    below = [setting for setting, (on, _) in closed.items() if side(on["ci"], FALSE) == "below"]
    keeps = all((found["held"]["ci"] or [0.0])[0] >= KEEPS for found in ghosts.values())
    heading = NOT if not below or not keeps else HOLDS if len(below) == len(SETTINGS) else PART
    said = "in no setting" if not below else "in either setting" if len(below) > 1 else f"with {below[0]} starts only"

    def told(setting: str) -> str:
        on, off = closed[setting]
        return f"{mean(on, 2)} with it and {mean(off, 2)} without"

    def effect(setting: str) -> str:
        found = ghosts[setting]
        return f"{ratio(found['false_tracks'])} and {ratio(found['held'], 3)}"

    already = [setting for setting in below if side(closed[setting][1]["ci"], FALSE) == "below"]
    not_it = " There the strict start does it, not the ghost logic." if below and already == below else ""
    return heading, (
        f"**Fewer than {FALSE:g} false confirmed tracks in a run with ghost logic: {said}.** Different ones in a run "
        f"of the closed loop: {both(told)}. Of the false tracks and of the targets' scans that are held ghost logic "
        f"leaves so many times as many: {both(effect)}.{not_it}"
    )


def _emergent(summary: dict[str, Any]) -> Finding:
    """What either half of the closed loop brings by itself."""
    filter_alone, scheduler_alone = (VSIMM, TURNS), (NCV, MYOPIC)

    def its_own(setting: str) -> bool:
        ours, theirs = (figures(summary, setting, of)["over_open"] for of in (filter_alone, scheduler_alone))
        return all(
            one["ci"] and other["ci"] and (one["ci"][1] < other["ci"][0] if fewer else one["ci"][0] > other["ci"][1])
            for one, other, fewer in ((ours[key], theirs[key], key == "rmse") for key in ("rmse", "confirmed"))
        )

    def told(loop: tuple[str, str], setting: str) -> str:
        over = figures(summary, setting, loop)["over_open"]
        return f"{change(over['confirmed'])} of confirmed tracks and {change(over['rmse'])} of error"

    clear = all(map(its_own, SETTINGS))
    return (NOT if clear else PART), (
        f"**The improvement {'does not emerge' if clear else 'may emerge'} from the whole"
        f"{': it is the filter' if clear else ''}.** The paper does not take its system apart and calls the "
        "improvement an emergent feature of it. Over the open loop the four models by themselves (round robin, VS-IMM) "
        f"have, {both(lambda setting: told(filter_alone, setting))}; the scheduler by itself (myopic, NCV) has, "
        f"{both(lambda setting: told(scheduler_alone, setting))}."
    )
