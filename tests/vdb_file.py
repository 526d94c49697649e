"""A small OpenVDB file, written once with xuvdb 1.4.0 (an implementation of the format that destello does not use) from

    x, y, z = np.indices((10, 6, 9))
    density = np.exp(-((x - 4.5) ** 2 / 8 + (y - 2.5) ** 2 / 4 + (z - 4) ** 2 / 6)), below 0.2: 0, to sixteenths
    heat = np.where(density > 0.5, 1000 + 500 * density, 0)[1:]

with voxels of 0.5, index (0, 0, 0) at (1, 2, 3), and the arrays' first voxels at (-2, 3, 5) and (-1, 3, 5).
"""

from __future__ import annotations

import base64
import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_PACKED = (
    "c-rmUJ#W)M7{GBS1yTW3!j9C4i6v5B(l%Y1G<8@IEL5zP8?MEYW0%;8f&@}N24e;!20j35K1x0UBU`!a*|BTV@)A;s^8ZPv=ZXE?"
    "`F!#eovz$8UmDUxwtI$_J815%wVJiv%Fg=6R;9YJzEjz+R-2VtYkSA6Jy|zvn+K{eFIz#jSHcUN@NG$^hg~78W7oGsYs;!yo2u+x"
    "H17UW9b3<JRNe2$c1t$T?g*6!Vb}3aQiI->Y1_4fAh~;2X2<?Xx$nEZj!;iMc3fe#{myAu1cBpwN$rZv>~`q%MY(UgJrS(L<wr;U"
    "!0I@jdO%;aH=X-3Ig^&6X=N(y!G%gyu`HX)r&H+r1L4Yv^t@2Lg5!nTRV!3w!)Og2$o8UbyW+5Gdx2|*;+cJ_Z+)#tH4Pn>qd2Mm"
    "UX1%^W9gC@KR1avBauJ9barL{00000fNPUu2><{90000mk336&#eH2DKQI2x1ONa4000000002s23TUh3GkmA4x^xx;dp#84yOe("
    "yBCT@b=;Cslw`;kS69<9zCNwX?m|k-XW~NXc{KKPn|mRKdr2EdP35EL0h3f5U2#3zKW=lcbasN1)I+kruc|HA4P&jY<9NpJY<>K4"
    "rF!y`4Vj<Tb&MBa*0mq{{l&57eXl=V&(s$;->0t!QU|!b7It{q0dVi51K-|+IzH+p51M@dTs-3Sp8l4L=AsU4yZZDuRi!>~HJM*H"
    "{q142T>sqZZ`u8s?AHVU00000000000N@5-w<Z9s5N+}+6!Pg9UtdiB(nr(y_Q^bt>HP7?G$x--<HHvn)496$v-_8f`yH9gUrz"
)


def vdb_bytes() -> bytes:
    """The file."""
    return zlib.decompress(base64.b85decode(_PACKED))


def density() -> NDArray[np.float32]:
    """What is in its grid "density": (x, y, z)."""
    x, y, z = np.indices((10, 6, 9))
    values = np.exp(-((x - 4.5) ** 2 / 8 + (y - 2.5) ** 2 / 4 + (z - 4) ** 2 / 6)).astype(np.float32)
    values[values < 0.2] = 0
    return np.asarray(np.round(values * 16) / 16, np.float32)


def heat() -> NDArray[np.float32]:
    """What is in its grid "heat"."""
    return np.where(density() > 0.5, 1000 + 500 * density(), 0).astype(np.float32)[1:]


def with_tile(where: str) -> bytes:
    """The file with one tile of 0.25 in "density": at the "root", in an "upper" or a "lower" node.

    "idle": at the root, not active. A node has masks of children and of values, a byte, the active values; a root has
    the numbers of its tiles and children, then these.
    """
    data = bytearray(vdb_bytes())
    first = data.index(b"Tree_float_5_4_3") + 20  # where grid, voxels and end are said to be
    start, voxels, end = struct.unpack_from("<3q", data, first)
    root = data.index(struct.pack("<IfII", 1, 0, 0, 2), start) + 4  # one buffer; background, no tiles, two children
    upper = root + 12 + 12
    lower = upper + 2 * 4096 + 1
    if where in ("root", "idle"):
        data[root + 4] = 1
        at, tile = root + 12, struct.pack("<3ifB", 4096, 0, 0, 0.25, where == "root")
        if where == "root":
            box = data.index(b"file_bbox_max", start) + 13 + 9 + 4
            struct.pack_into("<3i", data, box, 8191, 4095, 4095)
    else:
        node, size = (upper, 4096) if where == "upper" else (lower, 512)
        assert not data[node + size]
        data[node + size] = 2  # the second value is active
        at, tile = node + 2 * size + 1, struct.pack("<f", 0.25)
    data[at:at] = tile
    struct.pack_into("<2q", data, first + 8, voxels + len(tile), end + len(tile))
    other = data.index(b"Tree_float_5_4_3", end) + 20
    struct.pack_into("<3q", data, other, *(n + len(tile) for n in struct.unpack_from("<3q", data, other)))
    return bytes(data)
