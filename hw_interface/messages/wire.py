"""Bytes of a message: a msgpack envelope around a strictly checked pydantic model. No scheme that can run code.

    {"protocol": 4, "type": "stop_request", "crc": 1234567890, "body": {...}}

in this order; `crc` is the CRC-32 (zlib.crc32) of the type's UTF-8 bytes followed by the packed body. TCP's own sum of
16 bits is made anew by everything that forwards a stream, and plain zenoh carries whatever bytes it is given: without
the sum a bit that flipped on the way could move an arm elsewhere.

Arrays travel as {"dtype": "<f8", "shape": [n, 7], "data": bytes}, row by row, and are checked against each other
before numpy sees them.
"""

import struct
import zlib
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ClassVar, TypeVar

import msgpack
import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, ValidationError

from hw_interface.errors import MessageError
from hw_interface.messages.protocol import other_protocol

PROTOCOL_VERSION = 4  # raised whenever a message changes in a way that an older peer would misread
MAX_MESSAGE_BYTES = 32 * 1024 * 1024  # three minutes of trajectory (168 bytes a millisecond), or a 1280x960 frame
_ARRAY_KEYS = {"dtype", "shape", "data"}
_ENVELOPE = ("protocol", "type", "crc", "body")
_MAX_HEAD_BYTES = 256  # everything before the body
_MOST_COPIED = 0xFFFF  # bytes of an array; a larger one is copied once only, into the finished message
_BIN32 = struct.Struct(">BI")  # how msgpack begins bytes that are longer than 65535


class Message(BaseModel):
    """Base of everything that crosses the wire: unknown fields, wrong types and non-finite numbers are errors."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )
    type_name: ClassVar[str]


M = TypeVar("M", bound=Message)


def _array_from_wire(value: Any, dtype: np.dtype, shape: tuple[int | None, ...], finite: bool) -> np.ndarray:
    """Array of the declared type and shape, read-only; None in `shape` matches any length.

    Raises:
        ValueError: Anything else (pydantic turns it into an error that names the field).
    """
    if isinstance(value, np.ndarray):
        array = value
        if array.dtype != dtype:
            raise ValueError(f"array has type {array.dtype}; it must be {dtype}")
    else:
        if not isinstance(value, dict) or set(value) != _ARRAY_KEYS:
            raise ValueError(f"an array is a map with exactly the keys {sorted(_ARRAY_KEYS)}")
        if value["dtype"] != dtype.str:
            raise ValueError(f"array has dtype {value['dtype']!r}; it must be {dtype.str!r}")
        sizes, data = value["shape"], value["data"]
        if not isinstance(sizes, (tuple, list)) or not all(type(n) is int and n >= 0 for n in sizes):
            raise ValueError("array shape must be a list of whole numbers >= 0")
        if not isinstance(data, bytes):
            raise ValueError("array data must be bytes")
        expected = dtype.itemsize
        for n in sizes:  # Python integers: a hostile shape cannot overflow
            expected *= n
        if len(data) != expected:
            raise ValueError(f"array of shape {list(sizes)} needs {expected} bytes; {len(data)} came")
        array = np.frombuffer(data, dtype=dtype).reshape(sizes)
    same_rank = array.ndim == len(shape)
    if not same_rank or any(want not in (None, n) for n, want in zip(array.shape, shape, strict=True)):
        wanted = tuple("n" if n is None else n for n in shape)
        raise ValueError(f"array has shape {array.shape}; it must be {wanted}")
    if finite and not np.isfinite(array).all():
        raise ValueError(f"array is not finite at index {tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])}")
    array = np.ascontiguousarray(array).view()  # a view, so that the sender's own array stays writable
    array.flags.writeable = False
    return array


def _array_to_wire(array: np.ndarray) -> dict[str, Any]:
    data = array.tobytes() if array.nbytes <= _MOST_COPIED else np.ascontiguousarray(array).data.cast("B")
    return {"dtype": array.dtype.str, "shape": list(array.shape), "data": data}


def array_field(dtype: str, shape: tuple[int | None, ...], finite: bool = True) -> Any:
    """Type annotation of an array field: numpy `dtype` with byte order, `shape` with None where any length will do."""
    wanted = np.dtype(dtype)
    check: Callable[[Any], np.ndarray] = lambda value: _array_from_wire(value, wanted, shape, finite)  # noqa: E731
    return Annotated[np.ndarray, BeforeValidator(check), PlainSerializer(_array_to_wire)]


def encode(message: Message) -> bytes:
    """Bytes of a message.

    Raises:
        MessageError: The message would be larger than a peer accepts.
    """
    data = seal(message.type_name, _packed(message.model_dump()))
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError(
            "message", f"has {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are accepted; split the motion"
        )
    return data


def seal(type_name: str, body: bytes | Iterable[bytes | memoryview], protocol: int = PROTOCOL_VERSION) -> bytes:
    """The envelope around a packed body, whole or in pieces, with its check sum."""
    pieces = (body,) if isinstance(body, bytes) else tuple(body)
    packer = msgpack.Packer(use_bin_type=True, autoreset=False)
    packer.pack_map_header(len(_ENVELOPE))
    for part in ("protocol", protocol, "type", type_name, "crc", _checksum(type_name, *pieces), "body"):
        packer.pack(part)
    return b"".join((packer.bytes(), *pieces))  # the only copy of the body: pictures have megabytes


def _packed(content: Mapping[str, Any]) -> list[bytes | memoryview]:
    """A body in pieces that msgpack would make as one; large arrays of the message itself are pieces of their own."""
    large = {key for key, value in content.items() if isinstance(value, dict) and _is_large(value.get("data"))}
    if not large:
        return [msgpack.packb(content, use_bin_type=True) or b""]
    packer = msgpack.Packer(use_bin_type=True, autoreset=False)
    packer.pack_map_header(len(content))
    pieces: list[bytes | memoryview] = []
    for key, value in content.items():
        packer.pack(key)
        if key not in large:
            packer.pack(value)
            continue
        packer.pack_map_header(len(value))
        for name, part in value.items():
            packer.pack(name)
            if not _is_large(part):
                packer.pack(part)
                continue
            pieces += (packer.bytes(), _BIN32.pack(0xC6, part.nbytes), part)
            packer.reset()
    return [*pieces, packer.bytes()]


def _is_large(value: object) -> bool:
    return isinstance(value, memoryview) and value.nbytes > _MOST_COPIED


def decode(data: bytes, expected: type[M]) -> M:
    """The message of the expected type in these bytes.

    Raises:
        MessageError: Not such a message; names the field that is at fault ("protocol" for another version, "crc" for
            bytes that changed on the way).
    """
    if len(data) > MAX_MESSAGE_BYTES:
        raise MessageError("message", f"has {len(data)} bytes; at most {MAX_MESSAGE_BYTES} are accepted")
    type_name, crc, body = _open(data)
    if type_name != expected.type_name:
        raise MessageError("type", f"is {type_name!r}; '{expected.type_name}' was expected here")
    if crc != _checksum(expected.type_name, body):
        raise MessageError("crc", "does not fit the message: its bytes changed on the way; send it again")
    try:
        content = msgpack.unpackb(body, raw=False, use_list=False, strict_map_key=True)
    except Exception as error:  # msgpack raises a dozen kinds, among them plain ValueError and UnicodeDecodeError
        raise MessageError("message", f"has a body that is not msgpack ({type(error).__name__})") from None
    try:
        return expected.model_validate(content)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "body"
        raise MessageError(where, first["msg"]) from None


def type_of(data: bytes) -> str:
    """Type name that these bytes give themselves.

    Raises:
        MessageError: Another version, or no envelope.
    """
    return str(_open(data)[0])


def _open(data: bytes) -> tuple[object, object, memoryview]:
    """Type, sum and packed body of an envelope; the body is not copied.

    Raises:
        MessageError: Another version, or no envelope.
    """
    unpacker = msgpack.Unpacker(raw=False, use_list=False, strict_map_key=True)
    unpacker.feed(data[:_MAX_HEAD_BYTES])
    head: dict[str, object] = {}
    try:
        size = unpacker.read_map_header()
        for key in _ENVELOPE[:-1]:
            if unpacker.unpack() != key:
                break
            head[key] = unpacker.unpack()
            if key == "protocol":  # before the rest, which another version may have laid out otherwise
                _check_protocol(head[key])
        whole = len(head) == len(_ENVELOPE) - 1 and size == len(_ENVELOPE) and unpacker.unpack() == _ENVELOPE[-1]
    except MessageError:
        raise
    except Exception as error:  # as above
        raise MessageError("message", f"is not msgpack ({type(error).__name__})") from None
    if not whole:
        raise MessageError("message", f"must be a map with exactly the keys {', '.join(_ENVELOPE)}, in this order")
    return head["type"], head["crc"], memoryview(data)[unpacker.tell() :]


def _check_protocol(version: object) -> None:
    if type(version) is not int or version != PROTOCOL_VERSION:
        raise MessageError("protocol", other_protocol(version, PROTOCOL_VERSION))


def _checksum(type_name: str, *body: bytes | memoryview) -> int:
    checksum = zlib.crc32(type_name.encode())
    for piece in body:
        checksum = zlib.crc32(piece, checksum)
    return checksum
