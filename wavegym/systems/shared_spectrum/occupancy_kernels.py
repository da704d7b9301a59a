"""Which channels will be occupied in the next train: predictors, functions of the noise that was heard.

Each predicts every channel by itself, from whether the noise in it was above a threshold. The estimator of all
probabilities is that of Krichevsky and Trofimov (a Beta(1/2, 1/2) prior). ``gap``: steps from the last one heard to the
one predicted. Shapes: e environments, c channels, T steps; ``length`` (e,) of them were heard.
"""

# mypy: disallow-untyped-defs=False, check-untyped-defs=False
from __future__ import annotations

import numpy as np

from wavegym.core.kernels import inlined, kernel
from wavegym.systems.shared_spectrum.kernels import is_busy
from wavegym.systems.shared_spectrum.user_kernels import STRIDES

FOLLOWED = 3  # steps from which a path through the channels is that of a user; chosen on tuning worlds
SURE = 0.95  # probability that it moves on: the default's users begin anew in 3 % of the steps


@inlined
def occupied(e, c, n, heard, busy):
    """busy[:n]: whether channel c was occupied in each of the first n steps, 0 or 1."""
    for k in range(n):
        busy[k] = 1 if is_busy(heard[e, k, c]) else 0


@kernel
def counts(heard, length, gap, out):
    """out (e, c): the share of occupied steps, whatever their order."""
    for e in range(len(length)):
        for c in range(heard.shape[2]):
            on = 0.5
            for k in range(length[e]):
                on += 1.0 if is_busy(heard[e, k, c]) else 0.0
            out[e, c] = on / (length[e] + 1.0)


@kernel
def markov(heard, length, gap, out):
    """As ``counts``, by a Markov chain for each channel: the transitions counted so far."""
    busy = np.empty(heard.shape[1], np.int64)
    for e in range(len(length)):
        last = length[e] - 1
        for c in range(heard.shape[2]):
            occupied(e, c, length[e], heard, busy)
            on, total = 0.5, 1.0
            for k in range(last - gap + 1):
                if busy[k] == busy[last]:
                    total += 1.0
                    on += busy[k + gap]
            out[e, c] = on / total


@kernel
def reactions(heard, sent, first, width, length, gap, out):
    """As ``markov``, with the radar's own band in the context, too: some users leave after a collision.

    sent (e, H): the radar's bands, which hold ``width`` channels from ``first`` on, (b,) both.
    """
    busy, held = np.empty(heard.shape[1], np.int64), np.empty(heard.shape[1], np.int64)
    listened = heard.shape[1] - sent.shape[1]
    for e in range(len(length)):
        last = length[e] - 1
        for c in range(heard.shape[2]):
            occupied(e, c, length[e], heard, busy)
            for k in range(length[e]):
                b = sent[e, k - listened] if k >= listened else -1
                held[k] = 1 if b >= 0 and first[b] <= c < first[b] + width[b] else 0
            on, total = 0.5, 1.0
            for k in range(last - gap + 1):
                if busy[k] == busy[last] and held[k] == held[last]:
                    total += 1.0
                    on += busy[k + gap]
            out[e, c] = on / total


@kernel
def lags(heard, length, gap, most, memory, out):
    """As ``markov``, by a mixture of chains whose context is the channel ``gap`` to ``most`` steps ago.

    The weights are the chains' likelihoods, in which a step counts ``memory`` times as much as the one after it.
    """
    channels, steps = heard.shape[2], heard.shape[1]
    most = max(most, gap)
    evidence, chance = np.empty(most + 1), np.empty(most + 1)
    busy = np.empty(steps, np.int64)
    for e in range(len(length)):
        n = length[e]
        for c in range(channels):
            occupied(e, c, n, heard, busy)
            top = -1e300
            for lag in range(gap, most + 1):
                evidence[lag], chance[lag] = chain(busy, n, lag, gap, most, memory)
                top = max(top, evidence[lag])
            weight, found = 0.0, 0.0
            for lag in range(gap, most + 1):
                share = np.exp(evidence[lag] - top)
                weight += share
                found += share * chance[lag]
            out[e, c] = found / weight


@inlined
def chain(busy, n, lag, gap, most, memory):
    """(log likelihood of the steps from ``most`` on, probability of the next) of a chain with this lag."""
    on0, all0, on1, all1 = 0.5, 1.0, 0.5, 1.0
    evidence = 0.0
    for k in range(lag, n):
        if busy[k - lag]:
            chance = on1 / all1
            all1 += 1.0
            on1 += busy[k]
        else:
            chance = on0 / all0
            all0 += 1.0
            on0 += busy[k]
        if k >= most:
            evidence = memory * evidence + np.log(chance if busy[k] else 1.0 - chance)
    if n - 1 + gap < lag:
        return -1e300, 0.5
    return evidence, on1 / all1 if busy[n - 1 + gap - lag] else on0 / all0


@kernel
def stepped(heard, length, gap, most, memory, out):
    """As ``lags``, with the users that step through the channels followed one by one and taken out of the history.

    It knows how they move: by a constant number of channels, and around the end of the spectrum. A user is one that was
    heard in all of the last steps and explains ``FOLLOWED`` of them: a channel that was occupied in the step before and
    in the one after, too, needs no explanation, and stays in the history.
    """
    channels = heard.shape[2]
    rest, ahead = heard.copy(), np.zeros((len(length), channels), np.bool_)
    busy, left = np.empty(heard.shape[1:], np.bool_), np.empty(heard.shape[1:], np.bool_)  # left: to be explained
    for e in range(len(length)):
        n = length[e]
        for k in range(n):
            for c in range(channels):
                busy[k, c] = is_busy(heard[e, k, c])
        for k in range(n):
            for c in range(channels):
                left[k, c] = busy[k, c] and not (busy[max(k - 1, 0), c] and busy[min(k + 1, n - 1), c])
        end = n - 1
        while end >= FOLLOWED - 1:
            explained, steps, place, width, stride = best_path(busy, left, end)
            if explained < FOLLOWED:
                end -= 1
                continue
            take_out(left, rest[e], end, steps, place, width, stride)
            if end == n - 1:
                first = (place + gap * stride) % (channels - width + 1)
                ahead[e, first : first + width] = True
    lags(rest, length, gap, most, memory, out)
    for e in range(len(length)):
        for c in range(channels):
            if ahead[e, c]:
                out[e, c] = 1.0 - (1.0 - SURE) * (1.0 - out[e, c])


@inlined
def best_path(busy, left, end):
    """(explained, steps, place, width, stride) of the user that was heard in all of the last steps up to ``end``.

    It is the one that explains most steps in which a channel is ``left``; place: its first channel at ``end``.
    """
    channels = busy.shape[1]
    found = 0, 0, 0, 1, 0
    for width in range(1, min(2, channels) + 1):
        room = channels - width + 1
        for stride in STRIDES:
            for place in range(room):
                explained, k, first = 0, end, place
                while k >= 0 and busy[k, first] and busy[k, first + width - 1]:
                    explained += left[k, first] or left[k, first + width - 1]
                    k -= 1
                    first = (first - stride) % room
                if explained > found[0] or (explained == found[0] and width > found[3]):
                    found = explained, end - k, place, width, stride
    return found


@inlined
def take_out(left, rest, end, steps, place, width, stride):
    """Clear the channels that a user of ``best_path`` explains, in ``left`` and in ``rest``."""
    room, first = left.shape[1] - width + 1, place
    for k in range(end, end - steps, -1):
        for c in range(first, first + width):
            if left[k, c]:
                rest[k, c] = 0
            left[k, c] = False
        first = (first - stride) % room


@kernel
def context_tree(heard, length, gap, depth, out):
    """As ``markov``, by context-tree weighting over contexts of 0 to ``depth`` steps.

    Willems, Shtarkov and Tjalkens, IEEE Trans. Inf. Theory 41(3), 1995.
    """
    nodes = 1 << (depth + 1)
    on, total, own, mixed = np.empty(nodes), np.empty(nodes), np.empty(nodes), np.empty(nodes)
    busy = np.empty(heard.shape[1], np.int64)
    for e in range(len(length)):
        for c in range(heard.shape[2]):
            occupied(e, c, length[e], heard, busy)
            for i in range(nodes):
                on[i], total[i], own[i], mixed[i] = 0.5, 1.0, 0.0, 0.0
            for k in range(gap, length[e]):
                tree_update(busy, k, gap, depth, on, total, own, mixed)
            out[e, c] = tree_chance(busy, length[e] - 1 + gap, gap, depth, on, total, own, mixed)


@inlined
def node_of(busy, k, gap, depth):
    """The leaf of the context of step k: steps k - gap, k - gap - 1, ..."""
    node = 1
    for d in range(depth):
        node = 2 * node + (1 if k - gap - d >= 0 and busy[k - gap - d] else 0)
    return node


@inlined
def both(mixed, node):
    """ln of the probability of the two children together."""
    return mixed[2 * node] + mixed[2 * node + 1]


@inlined
def log_half_sum(a, b):
    """ln((exp a + exp b) / 2)."""
    top = max(a, b)
    return top + np.log(0.5 * (np.exp(a - top) + np.exp(b - top)))


@inlined
def tree_update(busy, k, gap, depth, on, total, own, mixed):
    """Count step k in all nodes of its context; own: ln of a node's estimator, mixed: of the weighted probability."""
    node = node_of(busy, k, gap, depth)
    for d in range(depth, -1, -1):
        chance = on[node] / total[node]
        own[node] += np.log(chance if busy[k] else 1.0 - chance)
        total[node] += 1.0
        on[node] += busy[k]
        mixed[node] = own[node] if d == depth else log_half_sum(own[node], both(mixed, node))
        node >>= 1


@inlined
def tree_chance(busy, k, gap, depth, on, total, own, mixed):
    """Probability that step k is occupied."""
    node, chance = node_of(busy, k, gap, depth), 0.5
    for d in range(depth, -1, -1):
        here = on[node] / total[node]
        if d == depth:
            chance = here
        else:
            share = 1.0 / (1.0 + np.exp(both(mixed, node) - own[node]))
            chance = share * here + (1.0 - share) * chance
        node >>= 1
    return chance
