"""What the RF/EO platforms' ``summary.json`` says beyond the paper."""

from __future__ import annotations

from typing import Any

from wavegym.reproduce.claims import EXTRA, Finding, side
from wavegym.reproduce.rf_eo import ADAPTIVE, DEPTHS, FAR, INFORMATION, MARGIN, PUBLISHED
from wavegym.reproduce.rf_eo_table import places
from wavegym.reproduce.rf_eo_words import both
from wavegym.reproduce.words import between, compared, mean, percent, share, written

JUDGED = str(DEPTHS[-1])  # the deepest lookahead decides what is said of all
CONSISTENT = 0.9  # share of steps inside the band that is taken for 95 % of dependent ones


def _information(summary: dict[str, Any]) -> Finding:
    def told(scene: str) -> str:
        found = summary["scenes"][scene]
        policy, agree = found["policies"][INFORMATION], found["agreement"]
        return (
            f"In the {scene} scene its cost is {compared(policy['over_myopic'])} times that of the least trace, its "
            f"RMS error over the last half {compared(policy['late_over_myopic'])} times; its PRF jumps at "
            f"{share(policy['jumps'])} of the platforms' steps, the least trace's at "
            f"{share(found['policies'][ADAPTIVE]['jumps'])}. Of the same belief both would choose the same at a "
            f"platform in {share(agree['both'])} of the steps (PRF {share(agree['prf'])}, pixel angle "
            f"{share(agree['angle'])})."
        )

    sides = [side(_of(summary, scene, INFORMATION)["over_myopic"]["ci"], 1.0) for scene in (PUBLISHED, FAR)]
    dearer = sum(where == "above" for where in sides)
    said = ("is no dearer", "is dearer in one scene", "is dearer in both scenes")[dearer]
    return EXTRA, f"**The paper's objective {said} than the least trace.** {told(PUBLISHED)} {told(FAR)}"


def _nees(summary: dict[str, Any]) -> Finding:
    found = [_of(summary, scene, ADAPTIVE)["nees"] for scene in (PUBLISHED, FAR)]
    consistent = all(of["inside"] >= CONSISTENT and of["band"][0] <= of["first"] <= of["band"][1] for of in found)

    def told(found: dict[str, Any]) -> str:
        settled = found["inside_settled"]
        return (
            f"{mean(found, 2)}, {written(found['first'], 2)} at the first step, its mean over runs and targets within "
            f"the 95 % band ({between(found['band'], 2)}) at {percent(found['inside'])} % of all steps and at "
            f"{percent(settled)} % of those after the tenth"
        )

    return EXTRA, (
        f"**The filter {'knows' if consistent else 'misjudges'} its error from the first step.** NEES (expected: "
        f"4) of the adaptive scheduler is {both(summary, told, 'policies', ADAPTIVE, 'nees')}. Called so if the first "
        f"step and at least {100 * CONSISTENT:g} % of all are within: neighbouring steps are alike, so the share "
        "scatters."
    )


def _lookahead(summary: dict[str, Any]) -> Finding:
    def told(found: dict[str, dict[str, Any]]) -> str:
        depths = sorted(found, key=JUDGED.__ne__)  # the one judged by, then the others
        return ", ".join(
            f"{written(found[H]['percent'], 1)} % ({between(found[H]['ci'], 1)}) at H = {H}" for H in depths
        )

    sides = [side(scene["lookahead"][JUDGED]["ci"], 0.0) for scene in summary["scenes"].values()]
    said = ("gains nothing that can be told", "gains in one scene", "gains in both scenes")[sides.count("above")]
    return EXTRA, (
        f"**Lookahead {said}.** Cost below the one-step scheduler's: {both(summary, told, 'lookahead')}. Judged by H = "
        f"{JUDGED}. The plan is improved one point of the grid at a time, not searched exhaustively; the table has its "
        "time."
    )


def _margin(summary: dict[str, Any]) -> Finding:
    def told(scene: str) -> str:
        found, other = summary["scenes"][scene], MARGIN[scene]
        here, there = found["policies"][ADAPTIVE], found["policies"][other]
        return (
            f"In the {scene} scene, where it is {found['margin']:g} standard deviations, {_tail(here)}; with "
            f"{other.partition(':')[2]} {_tail(there)}, cost {compared(there['over_myopic'])} times as great, "
            f"geometric mean {written(there['over_myopic']['geometric'], 2)}."
        )

    return EXTRA, f"**The margin of foresight.** {told(PUBLISHED)} {told(FAR)}"


def _tail(policy: dict[str, Any]) -> str:
    cost = policy["cost"]
    digits = places(cost["mean"])
    return (
        f"{share(policy['missed_first'])} of the runs lose a measurement at the first step that was foreseen, the mean "
        f"cost is {written(cost['mean'], digits)} m² and the median {written(cost['median'], digits)} m²"
    )


def _penalties(summary: dict[str, Any]) -> Finding:
    def told(found: dict[str, dict[str, Any]]) -> str:
        return ", ".join(
            f"{name} {compared(of['over_logistic'], 3)}" for name, of in found.items() if name != "logistic"
        )

    sides = [side(s["penalties"]["hard"]["over_logistic"]["ci"], 1.0) for s in summary["scenes"].values()]
    cheaper = all(where == "below" for where in sides)
    said = "cheaper than" if cheaper else "not surely cheaper than"
    why = " The soft edge keeps targets well inside, and pixels coarser than they need be." if cheaper else ""
    return EXTRA, (
        f"**A hard edge is {said} the logistic one.** Cost of the one-step scheduler over that with the logistic "
        f"penalty in its foresight: {both(summary, told, 'penalties')}.{why}"
    )


def _below(summary: dict[str, Any]) -> Finding:
    def told(policies: dict[str, Any]) -> str:
        return f"{share(policies[ADAPTIVE]['below_threshold'])} and {share(policies[INFORMATION]['below_threshold'])}"

    return EXTRA, (
        "**The least information.** Steps at which a target was foreseen to get less than t = "
        f"{summary['scenes'][PUBLISHED]['threshold']:g}: with the least trace and with the paper's objective, "
        f"{both(summary, told, 'policies')}. Foreseen with the scene's margin."
    )


def _of(summary: dict[str, Any], scene: str, policy: str) -> dict[str, Any]:
    found: dict[str, Any] = summary["scenes"][scene]["policies"][policy]
    return found


EXTRAS = (_information, _nees, _lookahead, _margin, _penalties, _below)
