"""What the agile chirps' ``summary.json`` says, in words: every number comes from there."""

from __future__ import annotations

from typing import Any

from wavegym.reproduce.agile_clutter import BEST_FIXED, BEST_FREE, FREE, FULL, LIBRARY, LINEAR
from wavegym.reproduce.agile_clutter_numbers import DROP, JUMP, WINDOWS
from wavegym.reproduce.agile_clutter_words import area, commonest, each, never, spans
from wavegym.reproduce.words import bullet, compared, geometric, mean, ratio, share, written

FACTOR = 4.0  # by which the agile scheduler is expected to beat the agile LFM chirp in clutter


def findings(summary: dict[str, Any]) -> str:
    """Markdown: what of the paper is reproduced, what only in part, what not."""
    parts = {
        "What is reproduced": (_gain, _jump, _laws),
        "What is reproduced only in part": (_shapes, _all_runs, _without_clutter),
        "What is not": (_particles, _paper),
        "What the paper does not ask": (_fixed, _kinds, _trackers),
    }
    return "\n\n".join(
        f"### {heading}\n\n" + "\n".join(bullet(line) for line in (tell(summary) for tell in tellers) if line)
        for heading, tellers in parts.items()
    )


def _gain(summary: dict[str, Any]) -> str:
    return (
        "**Agile phase functions beat the agile LFM chirp in clutter.** In the runs kept under both, the LFM chirp's "
        f"MSE over the fully agile scheduler's is {each(summary, ratio, 'policies', LINEAR, 'ratio_kept')}. The "
        f"interval {each(summary, _against_factor, 'policies', LINEAR, 'ratio_kept')}."
    )


def _jump(summary: dict[str, Any]) -> str:
    return (
        f"**The jump and the drop.** In clutter the fully agile scheduler's error at k = {JUMP}, when the second "
        f"target is first measured, over that at k = {JUMP - 1} is {each(summary, ratio, 'jump')}. At k = {DROP}, when "
        f"the first one is gone, over that at k = {DROP - 1} it is {each(summary, ratio, 'drop')}."
    )


def _laws(summary: dict[str, Any]) -> str:
    def of(window: str, kind: str) -> str:
        return each(summary, share, "choices", FULL, "kind", window, kind)

    return (
        f"**HFM early, PFM late, HFM again at k = {JUMP}, LFM never**, where each phase function has one shape. Of the "
        f"transmissions in kept runs HFM has, over k = {_steps('early')}, {of('early', 'HFM')}; at k = {JUMP} "
        f"{of('jump', 'HFM')}. Over k = {_steps('late')} PFM3 has {of('late', 'PFM')}. LFM has "
        f"{each(summary, never, 'choices', FULL, 'linear')}. The typical run transmits "
        f"{each(summary, spans, 'choices', FULL, 'typical')}."
    )


def _shapes(summary: dict[str, Any]) -> str:
    def of(window: str, clutter: str = "clutter") -> str:
        return each(summary, commonest, "choices", FREE, "share", window, clutter=clutter)

    def error(runs: str) -> str:
        return each(summary, compared, "policies", FREE, runs)

    return (
        "**Which phase function is chosen when follows from the shapes on offer.** The paper says of its Figure 3 that "
        "only HFM and the PFM chirp with kappa = 3 were selected, not which shapes were on offer. With the shapes free "
        f"([errata](errata.md) lists them) the choices over k = {_steps('early')} are {of('early')}; at k = {JUMP} "
        f"{of('jump')}; over k = {_steps('late')} {of('late')}. Over all steps HFM then has "
        f"{each(summary, share, 'choices', FREE, 'kind', 'all', 'HFM')} and LFM "
        f"{each(summary, never, 'choices', FREE, 'linear')}. What stays is that the chirp changes as a target becomes "
        f"known and changes back at k = {JUMP}. The MSE over that with one shape each is, in runs kept by both, "
        f"{error('ratio_kept')}; over all runs {error('ratio_all')}. Shapes beyond the list were not tried. Without "
        f"clutter the choices over k = {_steps('early')} are {of('early', 'no clutter')}, over all steps "
        f"{of('all', 'no clutter')}."
    )


def _all_runs(summary: dict[str, Any]) -> str:
    def of(tell: Any, policy: str, key: str) -> str:
        return each(summary, tell, "policies", policy, key)

    return (
        f"**The factor over LFM is that of the kept runs.** Over all runs it is {of(ratio, LINEAR, 'ratio_all')}; the "
        f"interval {of(_against_factor, LINEAR, 'ratio_all')}. The geometric mean of the runs' ratios, in which each "
        f"run counts alike, is {of(geometric, LINEAR, 'ratio_all')}: lost tracks weigh on the mean. Over all runs the "
        f"fully agile scheduler's MSE is {of(area, FULL, 'mse_all')}, its median {of(_median, FULL, 'mse_all')}. "
        f"Kept are of the LFM chirp's runs {of(share, LINEAR, 'kept')}, of the fully agile scheduler's "
        f"{of(share, FULL, 'kept')}; a wide gate loses few returns, so a kept LFM track need not be a good one."
    )


def _without_clutter(summary: dict[str, Any]) -> str:
    def points(policy: str, key: str) -> str:
        return each(summary, _mean, "policies", policy, key)

    def of(window: str, kind: str) -> str:
        return each(summary, share, "choices", FULL, "kind", window, kind, clutter="no clutter")

    def error(policy: str) -> str:
        return each(summary, compared, "policies", policy, "ratio_all", clutter="no clutter")

    return (
        f"**Gain and choices are the clutter's.** Without it the LFM chirp's MSE over the fully agile scheduler's is "
        f"{error(LINEAR)}; that of PFM3 alone {error('agile PFM')}. Of the transmissions HFM has at k = {JUMP} "
        f"{of('jump', 'HFM')}, PFM3 over all steps {of('all', 'PFM')}. LFM's errors in range and range-rate are large, "
        "each by itself, though almost perfectly correlated, and so are its gates. The false returns in them are, at "
        f"the first step, {points(LINEAR, 'clutter_1')}, where those in the fully agile scheduler's are "
        f"{points(FULL, 'clutter_1')}; over the episode, a step, {points(LINEAR, 'clutter')} against "
        f"{points(FULL, 'clutter')}."
    )


def _fixed(summary: dict[str, Any]) -> str:
    return (
        "**The best fixed chirp** (sensor A / sensor B), its MSE over the fully agile scheduler's: of one shape each, "
        f"{each(summary, _constant)}; with the shapes free, over the scheduler's that has them too, "
        f"{each(summary, _constant_free)}. Each is the one of least predicted variance on worlds of its own, the "
        "quantity that all schedulers here minimise. The library's one-step scheduler has "
        f"{each(summary, compared, 'policies', LIBRARY, 'ratio_kept')} in runs kept by both."
    )


def _kinds(summary: dict[str, Any]) -> str:
    alone = (
        f"{kind} alone {each(summary, compared, 'policies', f'agile {kind}', 'ratio_kept')}"
        for kind in ("PFM", "HFM", "EFM")
    )
    return (
        "**Each nonlinear chirp alone, of one shape.** MSE over that of all phase functions together, in clutter"
        f", in runs kept by both: {'; '.join(alone)}."
    )


def _trackers(summary: dict[str, Any]) -> str:
    if len(summary["trackers"]) < 2:
        return ""
    return (
        "**The tracker.** The fully agile scheduler's MSE in kept runs is "
        f"{each(summary, area, 'policies', FULL, 'mse_kept')}, its NEES (expected: 4) "
        f"{each(summary, _nees, 'policies', FULL, 'nees')}. JPDA merges the hypotheses of a scan into one Gaussian and "
        "so stays wide for longer; the particle filter keeps them apart."
    )


def _particles(summary: dict[str, Any]) -> str:
    tried = summary["convergence"]
    if not tried:
        return ""
    told = "; ".join(
        f"{count} particles: {share(of['kept'])} kept, MSE {area(of['mse_kept'])} in kept runs and "
        f"{area(of['mse_all'])} in all"
        for count, of in tried.items()
    )
    return (
        "**The paper's particle filter.** Ours samples histories of associations and keeps a Gaussian for each target "
        "given them (Rao-Blackwellised); the printed one samples states, see [errata](errata.md). Ours has "
        f"{summary['particles']} particles. What their number does, by the library's one-step scheduler on the first "
        f"{next(iter(tried.values()))['runs']} worlds: {told}."
    )


def _paper(summary: dict[str, Any]) -> str:
    return (
        "**Levels.** The paper prints no numbers beside its figures and not the share of runs it kept, so levels "
        f"cannot be compared. It has 500 runs; these are {summary['runs']}."
    )


def _against_factor(found: dict[str, Any]) -> str:
    """Whether a ratio is surely above FACTOR."""
    if found["ci"] is None:
        return f"is not known against {FACTOR:g}"
    low, high = found["ci"]
    return f"{'lies above' if low > FACTOR else 'lies below' if high < FACTOR else 'reaches below'} {FACTOR:g}"


def _constant(setting: dict[str, Any]) -> str:
    return _against(setting["policies"][BEST_FIXED], setting["best_fixed"][BEST_FIXED])


def _constant_free(setting: dict[str, Any]) -> str:
    return _against(setting["best_free"], setting["best_fixed"][BEST_FREE])


def _against(ratios: dict[str, Any], constant: dict[str, Any]) -> str:
    return (
        f"{' / '.join(constant['waveforms'])} has {compared(ratios['ratio_kept'])} in runs kept by both, "
        f"{compared(ratios['ratio_all'])} over all runs, geometric mean {geometric(ratios['ratio_all'])}"
    )


def _nees(found: dict[str, Any]) -> str:
    return mean(found, 2)


def _mean(found: dict[str, Any]) -> str:
    return written(found["mean"], 0)


def _median(found: dict[str, Any]) -> str:
    return f"{written(found['median'], 0)} m²"


def _steps(window: str) -> str:
    first, last = WINDOWS[window]
    return f"{first} to {last}"
