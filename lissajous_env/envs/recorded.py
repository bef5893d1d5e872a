"""Recording of the episodes of an environment; modules for drawing are imported on demand."""

from typing import TYPE_CHECKING

from lissajous_env.wording import shown
from lissajous_env.world.simulation import Simulation

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Follower
    from lissajous_env.replay import Replay


def followed(simulation: Simulation, world: int | None) -> "Follower | None":
    """Return a recorder of a world of a simulation, or None for no world.

    Raises:
        ValueError: there is no such world.
    """
    if world is None:
        return None
    if isinstance(world, bool) or not isinstance(world, int) or not 0 <= world < simulation.num_worlds:
        raise ValueError(f"record must be None or a world from 0 to {simulation.num_worlds - 1}, got {shown(world)}")
    from lissajous_env.episodes.recording import Follower

    return Follower(simulation, world)


def replay_of(follower: "Follower | None", policy: str, how: str, ended: bool = False) -> "Replay":
    """Return the current episode as a page or, if `ended`, the latest complete one if there is one.

    Raises:
        ValueError: nothing was recorded; the message contains `how` to enable it.
    """
    if follower is None:
        raise ValueError(f"replay requires an environment that was made with {how}")
    from lissajous_env.replay import Replay

    return Replay(follower.recording(policy, ended))
