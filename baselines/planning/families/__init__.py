"""The families of plans."""

from baselines.planning.families.base import Family
from baselines.planning.families.known import Known
from baselines.planning.families.lissajous import Lissajous
from baselines.planning.families.patrols import Patrols
from baselines.planning.families.shipped import Shipped
from baselines.planning.families.tuned import LINES, PARTITIONS

FAMILIES: tuple[Family, ...] = (Shipped(), Known(), PARTITIONS, LINES, Lissajous(), Patrols())
"""Every family; the first has the included classical policies with their defaults."""
