"""Files that declare what they do not hold, or ask for what lies outside of them."""

from __future__ import annotations

import resource
import struct
import subprocess
import sys
import time
import zlib
from pathlib import Path

import h5py
import numpy as np

from tests.conftest import ROOT

FASTEST, SMALLEST = 10.0, 500
"""Seconds of processor time and MiB in which a file is refused, imports included."""

REFUSE = """
import resource, sys
from sci_lightning.errors import BadInput
{read}
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read(*sys.argv[1:])
except BadInput as error:
    print(error)
else:
    print("READ")
print(before, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def refusal(read: str, *arguments: str | Path) -> str:
    """Run a reader in a process of its own, and return the one line with which it refuses.

    Args:
        read: Python that defines or imports the function ``read``.
        arguments: what it is called with.
    """
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-c", REFUSE.format(read=read), *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    line, memory = done.stdout.splitlines()
    assert line != "READ", f"{arguments} was read, {time.monotonic() - start:.1f} s"
    idle, peak = map(int, memory.split())
    assert (peak - idle) / 1024 < SMALLEST, f"{line}: {(peak - idle) // 1024} MiB"
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < FASTEST, line
    return line


def matlab5(path: Path, *variables: bytes) -> Path:
    """A MATLAB 5 file of elements."""
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(header + b"".join(variables))
    return path


def matrix(name: bytes, shape: tuple[int, ...], *parts: bytes, kind: int = 9) -> bytes:
    """The bytes of a matrix whose dimensions need not fit its numbers."""
    dimensions = struct.pack(f"<{len(shape)}i", *shape)
    content = struct.pack("<IIII", 6, 8, kind, 0) + element(5, dimensions) + element(1, name) + b"".join(parts)
    return struct.pack("<II", 14, len(content)) + content


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def compressed(*parts: bytes, zeros: int = 0) -> bytes:
    """A compressed element of MATLAB 5, with so many MiB of zeros at its end."""
    content = deflated(b"".join(parts), zeros)
    return struct.pack("<II", 15, len(content)) + content


def deflated(content: bytes, zeros: int = 0) -> bytes:
    """Content and so many MiB of zeros in zlib's format; one compressed MiB is repeated, which takes no time."""
    deflate = zlib.compressobj(1, wbits=-zlib.MAX_WBITS)
    first = deflate.compress(content) + deflate.flush(zlib.Z_FULL_FLUSH)
    mebibyte = deflate.compress(bytes(2**20)) + deflate.flush(zlib.Z_FULL_FLUSH)
    high, low = divmod(zlib.adler32(content), 2**16)
    high = (high + low * (zeros << 20)) % 65521  # Adler-32 of zeros that follow
    return b"\x78\x01" + first + zeros * mebibyte + deflate.flush() + struct.pack(">HH", high, low)


def npy(path: Path, shape: tuple[int, ...], content: bytes = b"") -> Path:
    """An .npy file whose header need not fit its numbers."""
    with path.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, {"descr": "|u1", "fortran_order": False, "shape": shape})
        stream.write(content)
    return path


def outside(file: h5py.File, name: str, how: str, secret: Path, shape: tuple[int, ...]) -> None:
    """A dataset of uint8 whose values lie in another file."""
    if how == "external storage":
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_external(str(secret).encode(), 0, h5py.h5f.UNLIMITED)
        space = h5py.h5s.create_simple(shape)
        h5py.h5d.create(file.id, name.encode(), h5py.h5t.NATIVE_UINT8, space, plist)
    elif how == "virtual dataset":
        layout = h5py.VirtualLayout(shape, np.uint8)
        layout[:] = h5py.VirtualSource(str(secret), "a", shape)
        file.create_virtual_dataset(name, layout)
    elif how == "external link":
        file[name] = h5py.ExternalLink(str(secret), "a")
    else:
        file["hidden"] = np.zeros(shape, np.uint8)
        file[name] = h5py.SoftLink("/hidden")
