"""Episodes of an environment that are kept while they are played. What draws is imported when it is asked for."""

from typing import TYPE_CHECKING

from lissajous_env.wording import shown
from lissajous_env.world.simulation import Simulation

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Follower
    from lissajous_env.replay import Replay


def followed(simulation: Simulation, world: int | None) -> "Follower | None":
    """Return what records a world of a simulation; None where none is to be recorded.

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
    """Return the episode that is played as a page, or where asked for the latest that has `ended`, if one has.

    Raises:
        ValueError: nothing was recorded; the message says `how` it would be.
    """
    if follower is None:
        raise ValueError(f"replay needs an environment that was made with {how}")
    from lissajous_env.replay import Replay

    return Replay(follower.recording(policy, ended))
