"""Counter-based randomness: a draw depends on the world's seed, the step, the entity and the purpose alone.

So world k is the same world in any batch, at any place in it, on any number of threads.
"""

import warp as wp

START = wp.constant(0)
BODY = wp.constant(1)
LOSS = wp.constant(2)
ACTUATOR = wp.constant(3)
MEASURE = wp.constant(4)
FAULT = wp.constant(5)
MESSAGE = wp.constant(6)
ENTRY = wp.constant(7)
ARRIVAL = wp.constant(8)
WANDER = wp.constant(9)
EPISODE = wp.constant(10)
UNSEEN = wp.constant(11)
ROGUE = wp.constant(12)
SPEED = wp.constant(14)
HOTSPOT = wp.constant(15)
_PURPOSES = wp.constant(16)
"""Purposes of draws, and a number above all of them. In the simulation, each purpose uses either `uniform` or
`stream`, which begin with the same hash."""


@wp.func
def step_key(seed: int, step: int) -> int:
    """Return the key of all draws of one world in one step."""
    return int(wp.rand_init(seed, step))


@wp.func
def uniform(key: int, entity: int, purpose: int) -> float:
    """Return one draw from [0, 1): the hash that would be the seed of a stream, used as the number itself."""
    return float(wp.rand_init(key, entity * _PURPOSES + purpose) >> wp.uint32(8)) * 5.9604645e-08


@wp.func
def stream(key: int, entity: int, purpose: int) -> wp.uint32:
    """Return the generator's state for one entity's draws of one purpose in the step of the key."""
    return wp.rand_init(key, entity * _PURPOSES + purpose)
