"""Other users of the band, one step at a time.

Shapes: e environments, u users, c channels. A user occupies ``WIDTH`` neighbouring channels from its ``PLACE`` on, or
none (``OFF``). Its noise is its power times its duty: the share of a train in which it transmits.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.counter_rng_kernels import stream, uniform
from wavegym.core.kernels import inlined

STATIC, BURSTS, STEPPED, HOPPING, LISTENING = range(5)
OFF = -1
STAY, MOVE, RETURN, TAKE_OVER, PLACE_OF_NEXT, STRIDE_OF_NEXT = range(6)  # draws of a user in a step

# Columns of ``users`` (e, u, 7), the parameters of each user. Schedulers do not see them.
KIND, WIDTH, NOISE = 0, 1, 2
LEAVE, COME = 3, 4  # probabilities: a burst ends, or a listening user leaves; a burst begins, or it returns home
PERIOD, PATTERN = 5, 6  # steps after which a hopping user repeats its pattern, and the pattern's number
# Columns of ``places`` (e, u, 4): where a user is, its own channel, channels a step, steps in its pattern.
PLACE, HOME, STRIDE, PHASE = range(4)
STRIDES = -3, -2, -1, 1, 2, 3  # of a stepped user
QUIET = 2.0  # noise below which a listening user hears nobody


@inlined
def advance_user(e, u, users, now, taken, heard, key, takeover, out):
    """Write user u of world e one step later to ``out``.

    taken[e]: first channel of the radar's last band, and the one above it; heard[e] (c,): noise of the last step;
    key: of the user in this step.
    """
    channels = heard.shape[1]
    kind, width = int(users[e, u, KIND]), int(users[e, u, WIDTH])
    room = channels - width + 1
    place, home, stride, phase = now[e, u, PLACE], now[e, u, HOME], now[e, u, STRIDE], now[e, u, PHASE]
    if uniform(key, TAKE_OVER) < takeover:  # it begins anew elsewhere
        home = int(uniform(key, PLACE_OF_NEXT) * room)
        stride = STRIDES[int(uniform(key, STRIDE_OF_NEXT) * len(STRIDES))]
        phase = int(uniform(key, STRIDE_OF_NEXT) * 1024)
        place = OFF if kind == BURSTS and place == OFF else home
    if kind == STATIC:
        place = home
    elif kind == BURSTS:
        goes_on = uniform(key, STAY) >= users[e, u, LEAVE] if place != OFF else uniform(key, STAY) < users[e, u, COME]
        place = home if goes_on else OFF
    elif kind == STEPPED:
        place = (place + stride) % room
    elif kind == HOPPING:
        phase = phase + 1
        pattern = stream(np.uint64(users[e, u, PATTERN]), home)
        place = int(uniform(stream(pattern, phase % int(users[e, u, PERIOD])), 0) * room)
    elif place == OFF or (overlaps(place, width, taken[e]) and uniform(key, STAY) < users[e, u, LEAVE]):
        place = free_place(width, room, taken[e], heard[e], uniform(key, MOVE))
    elif place != home and uniform(key, RETURN) < users[e, u, COME] and is_free(home, width, taken[e], heard[e]):
        place = home
    out[e, u, PLACE], out[e, u, HOME], out[e, u, STRIDE], out[e, u, PHASE] = place, home, stride, phase


@inlined
def overlaps(place, width, taken):
    """Whether channels from ``place`` on are also those of the radar's band."""
    return place != OFF and place < taken[1] and place + width > taken[0]


@inlined
def is_free(place, width, taken, heard):
    """Whether the radar's band and the noise leave the channels from ``place`` on free."""
    free = not overlaps(place, width, taken)
    for c in range(place, place + width):
        free = free and heard[c] < QUIET
    return free


@inlined
def free_place(width, room, taken, heard, draw):
    """One of the free places, each with the same probability, or ``OFF`` without any: the user waits."""
    count = 0
    for place in range(room):
        count += is_free(place, width, taken, heard)
    left = int(draw * count)
    for place in range(room):
        if is_free(place, width, taken, heard):
            if left == 0:
                return place
            left -= 1
    return OFF
