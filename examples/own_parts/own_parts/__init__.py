"""A scheduler, a reward and a chirp law of your own package, which have names after ``import own_parts``."""

import wavegym
from own_parts.chirp_laws import cubic
from own_parts.rewards import WorstTarget
from own_parts.schedulers import first_good

wavegym.register_scheduler("first-good", first_good)
wavegym.register_reward("worst-target", WorstTarget)
wavegym.register_chirp_law("cubic", cubic)
