"""Events and comments as text/event-stream (WHATWG HTML, 9.2), and the positions that are their ids."""

import json
import math
import struct
from dataclasses import dataclass

MEDIA_TYPE = "text/event-stream"
RETRY_MILLISECONDS = 2000
"""How long a client waits before it connects again."""
OPENING = f": polhode\nretry: {RETRY_MILLISECONDS}\n\n".encode("ascii")
"""Sent at once, so that a client knows that it is connected."""
HEARTBEAT = b": still here\n\n"
END = "end"
STATUS = "status"


@dataclass(frozen=True, slots=True)
class Told:
    """One event."""

    name: str
    at: float
    """Position in the order of changes, by the database's clock."""
    data: bytes
    """A JSON document in one line."""
    is_final: bool = False
    """Nothing follows about this job or sweep."""
    subject_id: str = ""
    """The job or sweep that it is about."""

    @property
    def id(self) -> str:
        """The event's id."""
        return id_of_position(self.at)

    def text(self) -> bytes:
        """Return it as it is sent."""
        head = f"event: {self.name}\nid: {self.id}\ndata: ".encode("ascii")
        return head + self.data + b"\n\n"


def end_of(reason: str, at: float) -> Told:
    """Return the last event of a stream."""
    return Told(END, at, json.dumps({"reason": reason}).encode("ascii"), is_final=True)


def id_of_position(at: float) -> str:
    """Return the id of events at an instant: good for every API process, and after a restart."""
    return struct.pack(">d", at).hex()


def position_of_id(text: str | None) -> float | None:
    """Return the instant of an id; None if it is none of ours, as of an id that was never sent."""
    try:
        (at,) = struct.unpack(">d", bytes.fromhex(text or ""))
    except (ValueError, struct.error):
        return None
    return float(at) if math.isfinite(at) and at >= 0.0 else None
