"""Colours of the pictures as RGB: a light ground, blue for the team, red for targets.

Objects that meet in a film are distinguishable for readers without red, green or blue cones, too.
"""

Colour = tuple[int, int, int]

PAPER = (250, 249, 246)
"""Behind everything."""
GROUND = (255, 255, 255)
"""The rectangle where it was sensed just now."""
IDLE = (238, 221, 188)
"""The rectangle where it was not covered for long."""
EDGE = (170, 178, 188)
INK = (34, 46, 60)
MUTED = (118, 128, 140)
HAIRLINE = (222, 222, 216)
CURVE = (142, 160, 184)
SENSING = (70, 134, 196)
LINK = (72, 92, 118)
ROBOT = (28, 78, 134)
WHEEL = (30, 38, 48)
GLASS = (196, 220, 240)
FAILED = (222, 128, 10)
REMOVED = (150, 156, 164)
TARGET = (212, 48, 56)
UNSEEN = (238, 172, 175)
"""A target out of sight, where targets are seen before they are detected."""
DETECTED = (8, 176, 120)
CONTACT = (222, 44, 196)


def mixed(low: Colour, high: Colour, share: float) -> Colour:
    """Return the colour at a share in [0, 1] between two colours."""
    red, green, blue = (round(a + (b - a) * share) for a, b in zip(low, high, strict=True))
    return red, green, blue
