"""Recordings: episodes as arrays, which can be saved, loaded and drawn."""

import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_origin, get_type_hints

import numpy as np
from numpy.lib.npyio import NpzFile

from lissajous_env.episodes.evaluation import ActingPolicy, EpisodeRunner
from lissajous_env.episodes.snapshot import Snapshot
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.settings.checks import LAST_SEED, is_whole
from lissajous_env.storage.files import replacing, undamaged
from lissajous_env.wording import require
from lissajous_env.world.contamination.labels import introduced_at
from lissajous_env.world.selection import of_world
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import NEVER

FORMAT = "lissajous recording 3"
"""Format written into every file; other formats are rejected."""
MOST_BYTES = 2**30
"""Limit on the total size of a recording [bytes]."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recorded episode.

    F = steps + 1 moments from the reset on, N robots, T target slots, R rows and C columns of the coverage grid, P rows
    and Q columns of that of contamination, D entries of an observation, A of an action, K terms of the reward.
    """

    scenario: Scenario
    """The scenario."""
    score: dict[str, Any]
    """Score row of the episode: the columns of `lissajous_env.world.columns.NAMES`."""
    observation_names: tuple[str, ...]
    """Names of the D entries, from `lissajous_env.world.observation.layout`."""
    reward_names: tuple[str, ...]
    """Names of the K terms: `lissajous_env.world.tally.TERMS`, then those of extensions."""
    position: Annotated[np.ndarray, "F N 3", np.float32]
    """(F, N, 3) float32 x, y, z of the robots [m]."""
    heading: Annotated[np.ndarray, "F N", np.float32]
    """(F, N) float32 headings [rad]."""
    speed: Annotated[np.ndarray, "F N", np.float32]
    """(F, N) float32 speeds over the ground [m/s]."""
    phase: Annotated[np.ndarray, "F N", np.float64]
    """(F, N) float64 theta of (1) in [0, 2 pi) [rad]."""
    status: Annotated[np.ndarray, "F N", np.int8]
    """(F, N) int8 WORKING, FAILED or REMOVED of `lissajous_env.world.state`."""
    target_position: Annotated[np.ndarray, "F T 2", np.float32]
    """(F, T, 2) float32 x, y of the targets [m]; before a target appears, where it will, unless it appears unseen.
    A target that appears anew after its detection counts as another target."""
    motion: Annotated[np.ndarray, "T", np.int32]
    """(T,) int32 STILL, DRIFTING, WANDERING, FLEEING or CUSTOM of `lissajous_env.world.targets.motion`."""
    appears_at: Annotated[np.ndarray, "T", np.int32]
    """(T,) int32 step in which a target appears."""
    found_at: Annotated[np.ndarray, "T", np.int32]
    """(T,) int32 step in which it was detected, or NEVER of `lissajous_env.world.state`."""
    found_early: Annotated[np.ndarray, "T", np.float32]
    """(T,) float32 share of that step that was left then, in [0, 1]."""
    sensed_at: Annotated[np.ndarray, "F R C", np.int32]
    """(F, R, C) int32 step in which a cell was last sensed, 0 also for never; the lowest row comes first."""
    contact: Annotated[np.ndarray, "M 3", np.int32]
    """(M, 3) int32 moment and two robots that have collided and not yet parted."""
    collisions: Annotated[np.ndarray, "F", np.int32]
    """(F,) int32 collisions so far."""
    heard_at: Annotated[np.ndarray, "F N 2", np.int32]
    """(F, N, 2) int32 step in which the latest message from each ring neighbour was sent; -1 for none yet."""
    introduced_at: Annotated[np.ndarray, "F P Q", np.int32]
    """(F, P, Q) int32 step since which a target in a cell can have stayed undetected, NEVER in cleared cells; (F, 1, 1)
    NEVER if `task.contamination` is None."""
    observation: Annotated[np.ndarray, "F N D", np.float32]
    """(F, N, D) float32 observations of the robots."""
    action: Annotated[np.ndarray, "F N A", np.float32]
    """(F, N, A) float32 action of the step that led to a moment, in [-1, 1]; zero at the reset. `action[f + 1]`
    follows `observation[f]`."""
    reward_terms: Annotated[np.ndarray, "F N K", np.float32]
    """(F, N, K) float32 terms of the reward of that step; zero at the reset."""

    def __len__(self) -> int:
        return len(self.position)

    @property
    def duration(self) -> float:
        """Time from the reset to the last moment [s]."""
        return (len(self) - 1) * self.scenario.task.step

    def snapshot(self, moment: int) -> Snapshot:
        """Return the state after a number of steps, from 0 to `len` - 1."""
        changing = ("position", "heading", "status", "target_position", "sensed_at")
        rest = {name: getattr(self, name)[moment] for name in changing} | {name: getattr(self, name) for name in _FIXED}
        return Snapshot(
            step=moment,
            world=0,
            seed=int(self.score["seed"]),
            contact=self.contact[self.contact[:, 0] == moment, 1:],
            collisions=int(self.collisions[moment]),
            **rest,
        )

    def save(self, path: str | Path) -> None:
        """Write a compressed .npz file for `load`, first under a temporary name.

        Raises:
            ValueError: the arrays exceed a gibibyte.
        """
        scenario = self.scenario.resolve().to_dict()
        del scenario["extensions"]  # a file must not cause imports
        names = {"observation_names": self.observation_names, "reward_names": self.reward_names}
        about = {"format": FORMAT, "scenario": scenario, "score": self.score, **names}
        arrays = {name: getattr(self, name).astype(dtype, copy=False) for name, dtype in ARRAYS.items()}
        _check_size(sum(array.nbytes for array in arrays.values()))
        with replacing(path) as temporary, open(temporary, "wb") as file:
            np.savez_compressed(file, about=np.array(json.dumps(about)), **arrays)


_DECLARED = {
    name: hint.__metadata__
    for name, hint in get_type_hints(Recording, include_extras=True).items()
    if get_origin(hint) is Annotated
}
"""Sizes and types of the arrays."""
_SHAPES = {name: sizes.split() for name, (sizes, _) in _DECLARED.items()}
ARRAYS = {name: np.dtype(dtype) for name, (_, dtype) in _DECLARED.items()}
"""Arrays of a recording with their types."""
_FIXED = tuple(name for name, shape in _SHAPES.items() if shape == ["T"])
"""Arrays with a number per target: constant ones, and those whose last state contains what happened to each target."""


class Recorder:
    """Records one world of a simulation: call `take` after the reset and after every step."""

    def __init__(self, simulation: Simulation, world: int = 0):
        self.simulation, self.world = simulation, world
        fixed = () if simulation.scenario.targets.respawn else _FIXED
        self._moments: dict[str, list[np.ndarray]] = {name: [] for name in ARRAYS if name not in fixed}
        self._last: Snapshot | None = None
        self._bytes = 0

    def take(self) -> None:
        """Record the current state, unless it is that of an episode that had ended before.

        Raises:
            ValueError: this is not exactly one step after the previous call, or the recording exceeds a gibibyte.
        """
        simulation, w = self.simulation, self.world
        now = Snapshot.of(simulation, w)
        due = 0 if self._last is None else self._last.step + 1
        if now.step == due - 1 and simulation.over[w]:
            return
        if now.step != due:
            raise ValueError(f"a recording must contain every step once: expected step {due}, got {now.step}")
        action = of_world(simulation.limited_action, w)
        arrays = vars(now) | {
            "contact": np.insert(now.contact, 0, now.step, axis=1),
            "speed": of_world(simulation.robots.speed, w),
            "phase": of_world(simulation.robots.phase, w),
            "heard_at": of_world(simulation.links.heard_at, w),
            "introduced_at": introduced_at(simulation, w),
            "observation": of_world(simulation.observation, w),
            "action": action if now.step > 0 else np.zeros_like(action),
            "reward_terms": of_world(simulation.reward_terms, w),
        }
        for name, history in self._moments.items():
            history.append(np.array(arrays[name]))
        self._bytes += sum(history[-1].nbytes for history in self._moments.values())
        _check_size(self._bytes)
        self._last = now

    def recording(self, policy: str = "") -> Recording:
        """Return the recording so far, with the current score and the name of the policy.

        Raises:
            ValueError: nothing was recorded, or targets that appeared anew make the recording exceed a gibibyte.
        """
        if self._last is None:
            raise ValueError("a recording must contain at least one moment, got none")
        join: dict[str, Any] = dict.fromkeys(self._moments, np.stack) | {"contact": np.concatenate}
        arrays = {name: join[name](history) for name, history in self._moments.items()}
        respawn, last = self.simulation.scenario.targets.respawn, self._last
        arrays |= _split_lives(arrays) if respawn else {name: getattr(last, name) for name in _FIXED}
        arrays = {name: arrays[name].astype(dtype, copy=False) for name, dtype in ARRAYS.items()}
        score = {"policy": policy, "episode": 0} | self.simulation.score([self.world])[0]
        names = self.simulation.layout.names, self.simulation.reward_term_names
        return Recording(self.simulation.scenario, score, *names, **arrays)


def _split_lives(slots: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of targets that appear anew in their slots, as if each time another target appeared.

    Args:
        slots: (F, T, 2) positions of the slots [m], and (F, T) the arrays of `_FIXED` at each moment.

    Raises:
        ValueError: the positions of all these targets exceed a gibibyte.
    """
    lives = [
        (slot, begin, end - 1)
        for slot, appears in enumerate(slots["appears_at"].T)
        for begin, end in pairwise([0, *np.flatnonzero(np.diff(appears)) + 1, len(appears)])
    ]
    _check_size(8 * len(slots["appears_at"]) * len(lives))
    slot, begin, last = np.array(lives, dtype=int).reshape(-1, 3).T
    moment = np.clip(np.arange(len(slots["appears_at"]))[:, None], begin, last)
    places = {"target_position": slots["target_position"][moment, slot]}
    return {name: slots[name][last, slot] for name in _FIXED} | places


def record(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seed: int = 0,
    device: Any = "cpu",
    **overrides: Any,
) -> Recording:
    """Play one episode and record it; a policy for a batch of worlds is recorded in the first world.

    Args:
        policy: A policy, as in `lissajous_env.evaluate`, but no function.
        scenario: Name of a scenario, or a `Scenario`.
        seed: Seed of the episode.
        device: Warp device.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Raises:
        InvalidActionError: the policy returned actions that have a wrong shape or are not finite (a ValueError).
        ValueError: an invalid scenario or seed.
    """
    return record_all(policy, named.build(scenario, **overrides), [seed], device)[0]


def record_all(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seeds: Sequence[int],
    device: Any = "cpu",
) -> list[Recording]:
    """Play and record an episode for each seed, `policy.num_worlds` at a time; the rest is as for `record`."""
    simulation = Simulation(scenario, policy.num_worlds, device=device)
    runner, recordings = EpisodeRunner(policy, simulation), []
    for first in range(0, len(seeds), policy.num_worlds):
        batch = seeds[first : first + policy.num_worlds]
        recorders = [Recorder(simulation, world) for world in range(len(batch))]
        runner.play(batch, lambda taken, recorders=recorders: [recorder.take() for recorder in recorders])
        recordings += [recorder.recording(runner.name) for recorder in recorders]
    return recordings


def load(path: str | Path) -> Recording:
    """Read a file of `Recording.save`; nothing is unpickled.

    Raises:
        ValueError: the file is damaged or no recording; the message names it.
        OSError: the file cannot be read.
    """
    with undamaged(path, "recording (.npz)"):
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive, NpzFile(file) as stored:
            _check_size(sum(member.file_size for member in archive.infolist()))
            about = json.loads(str(stored["about"]))
            arrays = {name: stored[name] for name in ARRAYS}
        if not isinstance(about, dict) or about.get("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT!r}")
        names = (tuple(about["observation_names"]), tuple(about["reward_names"]))
        recording = Recording(scenario_of_json(about["scenario"]), about["score"], *names, **arrays)
        _check_arrays(recording)
        _check_words(recording)
        return recording


def _check_arrays(recording: Recording) -> None:
    """Check the types, shapes and numbers of a recording, which fit its scenario and each other."""
    scenario, latest, spreading = recording.scenario, NEVER, recording.scenario.spreading
    sizes = {"F": len(recording), "N": scenario.num_robots, "T": len(recording.motion), "M": len(recording.contact)}
    sizes["C"], sizes["R"] = scenario.task.grid or (1, 1)
    sizes |= {"P": spreading.rows, "Q": spreading.columns, "A": scenario.action_size}
    sizes |= {"D": len(recording.observation_names), "K": len(recording.reward_names)}
    f, n = sizes["F"], sizes["N"]
    for name, letters in _SHAPES.items():
        shape = tuple(sizes[letter] if letter in sizes else int(letter) for letter in letters)
        array, dtype, place = getattr(recording, name), ARRAYS[name], f"its {name}"
        require(array.dtype == dtype, place, f"must be {dtype}", array.dtype)
        require(array.shape == shape and f > 0, place, f"must have shape {shape}", array.shape)
        is_range = array.dtype.kind != "i" or -latest <= array.min(initial=0) <= array.max(initial=0) <= latest
        rule = f"must contain finite numbers, whole ones up to {latest}"
        require(is_range and np.isfinite(array).all(), place, rule, array)
    shares, contact, most = recording.found_early, recording.contact, scenario.task.steps + 1
    require(((shares >= 0) & (shares <= 1)).all(), "its found_early", "must contain shares from 0 to 1", shares)
    fits = ((contact >= 0) & (contact < [f, n, n])).all()
    require(fits, "its contact", "must contain moments and robots of the recording", contact)
    require(f <= most, "its moments", f"must be at most {most}, the reset and all steps", f)


def _check_words(recording: Recording) -> None:
    """Check the names and the score of a recording."""
    names, score = (*recording.observation_names, *recording.reward_names), recording.score
    require(all(isinstance(word, str) for word in names), "its names", "must be text", names)
    plain = (str, int, float, type(None))
    is_plain = isinstance(score, dict) and all(isinstance(value, plain) for value in score.values())
    require(is_plain, "its score", "must contain numbers and text by name", score)
    require(is_whole(seed := score.get("seed"), 0, LAST_SEED), "its seed", f"must be from 0 to {LAST_SEED}", seed)


def _check_size(size: int) -> None:
    rule = f"must contain at most {MOST_BYTES:,} bytes: use a coarser task.grid, fewer targets or steps"
    require(size <= MOST_BYTES, "a recording", rule, size)
