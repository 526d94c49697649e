"""A crumpled sheet with texture seams, and its tangents by the reference implementation of MikkTSpace.

They were computed once by the package mikktspace 1.1.1 for Node.js (that code in WebAssembly, not used by destello)
from the triangles below without shared vertices, v upwards; in steps of 1 / 32767.
"""

from __future__ import annotations

import base64
import zlib

import numpy as np
from numpy.typing import NDArray

_WIDTH, _HEIGHT = 9, 7  # vertices
_PACKED = (
    "c-"
    "mc*TS!v@9EW#i6EoMkSP|K@tiWnEinbsKqoSJy(L?muMWKu!OSahDIj1dHQE6cXT_7TeE<{uhJxByy6e@@|B`Pw(CO))|E1I><(|Pdg5AEgf;~"
    "V2Uu<xHd*|=cGTt!Pq{gpHGindd~J>lB0?BWxbjNJ)EyAkglH{y}~N4sCR=u)&1?UnJSNcO6>Nh>=tidGS?__aQ%Xx{LJ;pSPUS|4sHwD()jNH"
    "F6!WalEA96pz+?g`~eS5(Q)v}_uBkuX(zsQc%k&$5G&vs0Vxrg}N_Db+d6R3F6pjD%afZL$9JhOe^m?uf0Ma;`!)-"
    "uLyrPM;wg@9ih@gIbNEH63}9dRr^rF4Z*Z^0M)645+z5k8He)Bfp$_S~lJ_;Q^(z(p0zTpEGC5#9NO)AMZ`b#`}uiH2lXY8}C%iHM4b4Hr`i{@"
    "0ndUL(y6T&n9i`5$}db+r*qxHr^`&>CEPYY`h<-"
    "joELbvhltZm~L;dzV|R%@Al`#dtrRO?e}8Ycu&_(<z_3g@h*>hvU8KN@oqonEWc;{pB{%UIPUg|w=di<`oS$5?~UPoWhDc$@je=PlKnDSHr`!<"
    "qe|+XsZQ2w3*FzvyDPfZ{?aWQ?+N;W{2W6z-"
    "g^AHBj%BfceQrIu}_h0sy6E*Pu>IXGm#}fx`$=sJtrJ2Dyfu>w?F(*skQp)iB{XbeG%`1wm*N+B^&SMv3a@PKG}G`kESMWn<X3X*ZSeIJ8A3pR"
    "G+fdW~!@$yPQvJERR4{>9T}uyu<3vpXWzq<Gm)>nJrl)8}Fe=lRf_3RFh-(hhFKK`$MmA?hn1fxj*y^|95}Jdi~e)*!`hbIQNHM;oKkkh2u-"
    "F^o%dP!tte7IKK1?$CqB|8DDyZ<4dn_eCZdCFTK(;zVr&mmtNuc(k~oedZlN4=@pJIy~6ROUpT(>O3(PxD;!^Xh2u-"
    "FaD3_2ZuMJbh%ddu@ugQdzVr*nmtN@^UwVb(ORsQz=@<V0{ek04uk?&By~6ROUpT(po!--"
    "#1>PR<<?g`o<?g`o<?g__Kir*1txL<jPVwdL!13ko!13ko!2bdWj%D@"
)


def sheet() -> dict[str, NDArray[np.generic]]:
    """Positions, normals, uvs, indices. The texture is mirrored about x = 4 and stands still in one row of squares."""
    y, x = (axis.reshape(-1).astype(np.float64) for axis in np.mgrid[:_HEIGHT, :_WIDTH])
    height = (7 * x * x + 5 * x * y + 3 * y * y) % 11 / 16  # what any computer finds alike
    slope_x, slope_y = (3 * x + y) % 7 / 8 - 0.375, (x + 2 * y) % 5 / 8 - 0.25
    normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], 1)
    u, v = np.abs(x - 4) / 4 + (x + 3 * y) % 4 / 64, np.where(y > 4, y - 1, y) / 4 + (2 * x + y) % 3 / 32
    u = np.where((y == 4) | (y == 5), np.abs(x - 4) / 4, u)
    v = np.where((y == 4) | (y == 5), 1.0, v)
    i = (np.arange(_HEIGHT - 1)[:, None] * _WIDTH + np.arange(_WIDTH - 1)).reshape(-1)
    right, up = i + 1, i + _WIDTH
    triangles = np.concatenate([np.stack([i, right, up + 1], 1), np.stack([i, up + 1, up], 1)])
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return {
        "positions": np.stack([x, y, height], 1).astype(np.float32),
        "normals": unit.astype(np.float32),
        "uvs": np.stack([u, v], 1).astype(np.float32),
        "indices": triangles.astype(np.uint32),
    }


def reference() -> NDArray[np.float64]:
    """(triangles, corners, 4); 1, 0, 0 where it found no direction."""
    steps = np.frombuffer(zlib.decompress(base64.b85decode(_PACKED)), "<i2")
    return steps.reshape(-1, 3, 4) / 32767
