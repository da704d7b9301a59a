"""Seeds and tapes of worlds, from ``wavegym.core.worlds``: environments, which are below, tune schedulers on some."""

from wavegym.core.worlds import draw_worlds, training_seeds, tuning_tapes, tuning_worlds, word, world_seeds

__all__ = ["draw_worlds", "training_seeds", "tuning_tapes", "tuning_worlds", "word", "world_seeds"]
