"""A ship's radar in ten lines: a published system with other parameters, and (in ``scalar``) your own system."""

import wavegym

wavegym.register(
    "own/ShipRadar-v0",
    "wavegym.systems.kershaw_evans.system:KershawEvans",
    carrier_hz=3e9,  # S band
    q=0.01,  # ships do not manoeuvre much
    dt=2.0,
    start_range=(5e3, 30e3),
    start_speed=(-15.0, 15.0),
)
wavegym.register("own/ScalarDwell-v0", "own_environment.scalar:ScalarDwell")
