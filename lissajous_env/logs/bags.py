"""The files of a log, rosbag2 files (MCAP), and the samples in their messages, by topic.

The samples of a topic of one robot are together. A topic of several robots has those of each part of it: "car_2" for a
frame of /tf, "2" for the third pose of an array.
"""

import contextlib
import dataclasses
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lissajous_env.logs.messages import rosbags, seconds, type_store
from lissajous_env.storage.files import undamaged
from lissajous_env.wording import counted, few_of, require

LARGEST = 1e12
"""Limit on the numbers of a log, whose squares are finite in 32 bits."""
_LOG = "rosbag2 file (.mcap) or folder"

Sample = tuple[str, Any, tuple[str, ...], Sequence[Any]]
"""The part of a topic, the header or None, the names of its values, or (), and its values."""
Decoder = Callable[[Any], list[Sample]]
"""Function that returns the samples in a message, and raises a ValueError with the reason for one without any."""


@dataclass(frozen=True)
class Samples:
    """K samples, one of each message."""

    bag: np.ndarray
    """(K,) number of the file."""
    logged: np.ndarray
    """(K,) time of the recorder [s]."""
    stamp: np.ndarray
    """(K,) time of the header [s]; NaN for messages without one."""
    frame: np.ndarray
    """(K,) name of the header's frame."""
    values: np.ndarray
    """(K, A) numbers, or texts."""
    names: tuple[str, ...] = ()
    """Names of the values, if the messages have any."""

    def __len__(self) -> int:
        return len(self.stamp)

    def take(self, rows: Any) -> "Samples":
        """Return some rows, by a mask, numbers or a slice."""
        return dataclasses.replace(self, **{name: value[rows] for name, value in vars(self).items() if name != "names"})

    def in_order(self, same: float = 0.0) -> "Samples":
        """Return the rows by their stamps; of those that differ by at most `same` [s], the last one."""
        rows = self.take(np.argsort(self.stamp, kind="stable"))
        return rows.take(np.append(np.diff(rows.stamp) > same, True))


class Bags(contextlib.ExitStack):
    """The files of a log, open until this is left.

    Args:
        paths: Files (.mcap) or folders of rosbag2.

    Attributes:
        paths: Its files and folders.
        name: Name of the log.
        poses: Poses of the topics that `lissajous_env.logs.samples.poses_of` has read, by topic and part.
        kinds: Types of each topic's messages; a topic may have several. A type of another encoding than that of ROS 2
            has it in its name.
        remarks: Number of messages with a remark, by remark and topic.

    Raises:
        MissingExtraError: rosbags, of the extra `logs`, is not installed.
        ValueError: a file is damaged or no log.
        OSError: a file cannot be read.
    """

    def __init__(self, paths: Sequence[Path]):
        super().__init__()
        self.paths = tuple(paths)
        self.name = paths[0].name if len(paths) == 1 else f"{paths[0].name} and {len(paths) - 1} more"
        self.poses: dict[str, dict[str, Samples]] = {}
        self._store = type_store()  # of ROS alone: the types that a file defines are not compiled
        self.kinds: dict[str, set[str]] = {}
        self.remarks: dict[str, Counter[str]] = defaultdict(Counter)
        try:
            self._readers = [(bag, reader) for bag, path in enumerate(paths) for reader in self._opened(path)]
        except BaseException:
            self.close()
            raise
        for connection in (connection for _, reader in self._readers for connection in reader.connections):
            kind = _kind_of(connection)
            self.kinds.setdefault(connection.topic, set()).add(kind)
            if kind != connection.msgtype and connection.msgcount:
                self.remark(connection.topic, f"ignored: type {kind} is not understood", connection.msgcount)

    def _opened(self, path: Path) -> list[Any]:
        """Return the readers of a file, or of those of a folder: its list of topics may have types that are refused."""
        require(path.is_file() or path.is_dir(), "logs", "must be existing files or folders", str(path))
        rule = "must be rosbag2 files (.mcap) or folders; tables of poses are scored in Python (docs/robots.md)"
        require(path.is_dir() or path.suffix in (".mcap", ".db3"), "logs", rule, str(path))
        files = sorted(path.glob("*.mcap")) if path.is_dir() else []
        with undamaged(path, _LOG), _any_encoding():
            return [self.enter_context(rosbags().Reader(file)) for file in files or [path]]

    def remark(self, topic: str, words: str, count: int = 1) -> None:
        """Count some messages of a topic that a note describes as "are `words`"."""
        self.remarks[words][topic] += count

    def notes(self) -> list[str]:
        """Return the remarks, those with the same words on several topics as one."""
        notes = []
        for remark, topics in sorted(self.remarks.items()):
            messages, verb = counted(topics.total(), "message"), "is" if topics.total() == 1 else "are"
            notes.append(f"{messages} of {few_of(sorted(topics))} {verb} {remark}")
        return notes

    def files_with(self, topic: str) -> list[int]:
        """Return the numbers of the files that contain a topic."""
        return sorted({bag for bag, reader in self._readers if any(c.topic == topic for c in reader.connections)})

    def samples(self, topic: str, decoders: dict[str, Decoder], bag: int | None = None) -> dict[str, Samples]:
        """Return the samples of a topic by part, file by file in the order of the recording.

        Messages of other types, those that are damaged or without a sample, and samples with other names or another
        number of values than the first, are ignored and counted in `remarks`.

        Args:
            topic: The topic.
            decoders: Functions that decode its messages, by their types.
            bag: Number of the only file that counts; None for all.

        Raises:
            ValueError: a file is damaged.
        """
        rows: dict[str, list[tuple]] = defaultdict(list)
        forms: dict[str, tuple[tuple[str, ...], int]] = {}
        for number, logged, (part, header, names, values) in self._decoded(topic, decoders, bag):
            if forms.setdefault(part, (names, len(values))) != (names, len(values)):
                self.remark(topic, "ignored: other names or another length than the first")
                continue
            about = (math.nan, "") if header is None else (seconds(header.stamp), header.frame_id.strip("/"))
            rows[part].append((number, logged, *about, values))
        return {
            part: Samples(*map(np.array, zip(*own, strict=True)), names=forms[part][0]) for part, own in rows.items()
        }

    def finite(self, topic: str, samples: Samples, count: int | None = None) -> Samples:
        """Return the rows of a topic whose first values are finite and no larger than `LARGEST`, and remark others."""
        sound = (np.abs(samples.values[:, :count]) <= LARGEST).all(axis=1)
        if not sound.all():
            self.remark(topic, f"ignored: numbers that are not finite or above {LARGEST:g}", int((~sound).sum()))
        return samples.take(sound)

    def _decoded(
        self, topic: str, decoders: dict[str, Decoder], bag: int | None
    ) -> Iterator[tuple[int, float, Sample]]:
        """Yield the number of the file, the time of the recorder [s] and the sample of all that is understood."""
        for number, reader in self._readers:
            if bag not in (None, number):
                continue
            channels = [c for c in reader.connections if c.topic == topic and _kind_of(c) == c.msgtype and c.msgcount]
            for connection in channels:
                if (kind := connection.msgtype) not in decoders:
                    self.remark(topic, f"ignored: type {kind} is not understood there", connection.msgcount)
            known = [connection for connection in channels if connection.msgtype in decoders]
            with undamaged(self.paths[number], _LOG):
                for connection, logged, raw in reader.messages(known) if known else ():
                    try:
                        if raw[:4] == b"\x28\xb5\x2f\xfd":  # compressed on its own; others begin with a byte of zeros
                            raw = rosbags().storage_mcap.DECOMPRESSORS["zstd"](raw, 0)
                        content = self._store.deserialize_cdr(raw, connection.msgtype)
                    except Exception:  # damaged bytes can raise almost any error in the library
                        self.remark(topic, f"ignored: cut off or damaged, of type {connection.msgtype}")
                        continue
                    try:
                        samples = decoders[connection.msgtype](content)
                    except ValueError as error:
                        self.remark(topic, f"ignored: {error}")
                        continue
                    yield from ((number, logged / 1e9, sample) for sample in samples)


def _kind_of(connection: Any) -> str:
    """Return the type of a channel's messages, with their encoding if it is not that of ROS 2."""
    encoding = connection.ext.serialization_format
    return connection.msgtype if encoding == "cdr" else f"{connection.msgtype} in the encoding {encoding}"


@contextlib.contextmanager
def _any_encoding() -> Iterator[None]:
    """Let the library open files in which some channels have another encoding than those of ROS 2.

    It would refuse the whole file because of the schema of such a channel. No schema is needed here.
    """
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.rosbag2 import storage_mcap as storage

    before = storage.read_string, storage.get_msgdef
    storage.read_string = lambda bio: storage.read_bytes(bio).decode(errors="replace")
    storage.get_msgdef = lambda _schema: MessageDefinition(MessageDefinitionFormat.NONE, "")
    try:
        yield
    finally:
        storage.read_string, storage.get_msgdef = before
