"""Encodes a JSON document that may be large: compressed, with a checksum of its content."""

import json
import zlib
from collections.abc import Mapping

from service.storage.codecs.arrays import CodecError

Document = Mapping[str, object]


def encode_document(document: Document) -> bytes:
    """Return the document as bytes (RFC 1950, whose last four are the checksum)."""
    return zlib.compress(json.dumps(document, allow_nan=False, separators=(",", ":")).encode())


def decode_document(data: bytes) -> Document:
    """Return an encoded document, or raise :class:`~service.storage.codecs.arrays.CodecError`."""
    try:
        document = json.loads(zlib.decompress(data))
    except (zlib.error, ValueError) as fault:
        raise CodecError(f"no document: {fault}") from fault
    if not isinstance(document, dict):
        raise CodecError("no document: its JSON is no object")
    return document
