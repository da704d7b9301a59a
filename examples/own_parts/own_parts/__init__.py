"""A scheduler, a reward and a chirp law of one's own, known by name after ``import own_parts``."""

import wavegym
from own_parts.chirp_laws import cubic
from own_parts.rewards import WorstTarget
from own_parts.schedulers import every_other

wavegym.register_scheduler("every-other", every_other)
wavegym.register_reward("worst-target", WorstTarget)
wavegym.register_chirp_law("cubic", cubic)
