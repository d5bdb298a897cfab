"""Proof files: what is claimed of a motion, and everything that is needed to check it.

A proof is one .npz file of plain arrays (nothing is unpickled). For each group of pairs (`scene`,
`own`) it holds the claim (lower, upper), the problem (kinematic tree, shapes, pairs, knots and
their times, deviation), the planes, and the witness. docs/certificate.md lists the fields.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pips_drake.errors import InputError
from pips_drake.twin.certificate.bodies import Shapes
from pips_drake.twin.certificate.certify import ClearanceCertificate
from pips_drake.twin.certificate.problem import Problem
from pips_drake.twin.certificate.search import Certificate
from pips_drake.twin.certificate.tree import Tree
from pips_drake.twin.output_folder import write_whole

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Of the file's layout.
VERSION = 2
#: Versions that are read: the first had no swept planes.
_READABLE = (1, 2)
GROUPS = ("scene", "own")
# A file that unpacks to more than this is refused, bytes.
_LARGEST = 4 * 2**30


@dataclass(frozen=True, kw_only=True, eq=False)
class Proof:
    """One group's claim and its proof, as a file holds it.

    Attributes:
        lower, upper: what is claimed of the least distance, m.
        problem: what it is claimed of.
        pair, first, last, start, end, normals, swept: the planes; see `blocks.Planes`.
        witness: the pair, segment and fraction where the distance is at most `upper`.
        weights, vertices, balls: of points on its cores; see `distance.Closest`.
        hull_vertices, hull_balls: of points in deep penetration, (H, 2) and (H, 2, 3).
        off: how far the witness's positions are off, (nq,).
    """

    lower: float
    upper: float
    problem: Problem
    pair: Indices
    first: Indices
    last: Indices
    start: Array
    end: Array
    normals: Array
    swept: NDArray[np.bool_]
    witness: tuple[int, int, float]
    weights: Array
    vertices: Indices
    balls: Array
    hull_vertices: Indices
    hull_balls: Array
    off: Array


def make_proof(certificate: Certificate) -> Proof:
    """The proof of a certificate."""
    planes, witness = certificate.planes, certificate.witness
    return Proof(
        lower=certificate.lower,
        upper=certificate.upper,
        problem=certificate.problem,
        pair=planes.pair,
        first=planes.first,
        last=planes.last,
        start=planes.start,
        end=planes.end,
        normals=planes.normals,
        swept=planes.swept,
        witness=(witness.pair, witness.segment, witness.fraction),
        weights=witness.closest.weights,
        vertices=witness.closest.vertices,
        balls=witness.closest.balls,
        hull_vertices=witness.closest.hull_vertices,
        hull_balls=witness.closest.hull_balls,
        off=witness.deviation,
    )


def save_proof(file: Path, certificate: ClearanceCertificate) -> None:
    """Writes the proofs of both groups; the same certificate gives the same bytes."""
    arrays: dict[str, Any] = {"version": np.array(VERSION)}
    for group in GROUPS:
        made = getattr(certificate, group)
        if made is None:
            continue
        proof = make_proof(made)
        for name, value in _as_arrays(proof).items():
            arrays[f"{group}.{name}"] = value
    packed = io.BytesIO()
    np.savez_compressed(packed, **arrays)
    write_whole(file, packed.getvalue())


def load_proof(file: Path) -> dict[str, Proof]:
    """The proofs in a file, by group. Nothing in it has been checked but its layout.

    Raises:
        InputError: not a proof file.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            if sum(info.file_size for info in archive.infolist()) > _LARGEST:
                raise InputError(f"{file}: too large for a proof; must be <= 4 GiB unpacked")
        with np.load(file, allow_pickle=False) as packed:
            arrays = {name: packed[name] for name in packed.files}
    except FileNotFoundError:
        raise InputError(f"{file}: no such file") from None
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{file}: not a proof ({error})") from None
    version = arrays.get("version")
    if version is None or version.shape != () or version not in _READABLE:
        raise InputError(f"{file}: not a proof of version {' or '.join(map(str, _READABLE))}")
    found = {}
    for group in GROUPS:
        mine = {
            name.removeprefix(f"{group}."): value
            for name, value in arrays.items()
            if name.startswith(f"{group}.")
        }
        if mine:
            try:
                found[group] = _from_arrays(mine)
            except InputError as error:
                raise InputError(f"{file}: {group}: {error}") from None
    if not found:
        raise InputError(f"{file}: proves nothing")
    return found


def _as_arrays(proof: Proof) -> dict[str, NDArray]:
    problem = proof.problem
    arrays: dict[str, NDArray] = {
        "lower": np.array(proof.lower),
        "upper": np.array(proof.upper),
        "names": np.array(problem.names, dtype=np.str_),
        "bodies": np.array(problem.bodies, dtype=np.str_),
        "a": problem.a,
        "b": problem.b,
        "times": problem.times,
        "knots": problem.knots,
        "deviation": problem.deviation,
        "plane_pair": proof.pair,
        "plane_first": proof.first,
        "plane_last": proof.last,
        "plane_start": proof.start,
        "plane_end": proof.end,
        "plane_normals": proof.normals,
        "plane_swept": proof.swept.astype(np.int64),
        "witness": np.array(proof.witness, dtype=np.float64),
        "witness_weights": proof.weights,
        "witness_vertices": proof.vertices,
        "witness_balls": proof.balls,
        "witness_hull_vertices": proof.hull_vertices,
        "witness_hull_balls": proof.hull_balls,
        "witness_off": proof.off,
    }
    arrays |= {f"tree_{name}": value for name, value in problem.tree._asdict().items()}
    for name in _SHAPE_FIELDS:
        arrays[f"shape_{name}"] = getattr(problem.shapes, name)
    return arrays


#: Of `Shapes`, those that a check needs; the rest only helps to find planes.
_SHAPE_FIELDS = ("body", "vertices", "starts", "bulge", "radius", "half_space")


def _from_arrays(arrays: dict[str, NDArray]) -> Proof:
    def real(name: str, *shape: int) -> Array:
        return _array(arrays, name, "f", shape)

    def whole(name: str, *shape: int) -> Indices:
        return _array(arrays, name, "i", shape)

    count, shapes = len(real("times", -1)), len(whole("shape_body", -1))
    bodies, pairs = len(whole("tree_parent", -1)), len(whole("a", -1))
    knots, planes = real("knots", count, -1), len(whole("plane_pair", -1))
    arrays = {"plane_swept": np.zeros(planes, dtype=np.int64)} | arrays
    nq, hull = knots.shape[1], len(whole("witness_hull_vertices", -1, 2))
    vertices, starts = real("shape_vertices", -1, 3), whole("shape_starts", shapes + 1)
    tree = Tree(
        parent=whole("tree_parent", bodies),
        kind=whole("tree_kind", bodies),
        start=whole("tree_start", bodies),
        R_PF=real("tree_R_PF", bodies, 3, 3),
        p_PF=real("tree_p_PF", bodies, 3),
        axis=real("tree_axis", bodies, 3),
        R_MB=real("tree_R_MB", bodies, 3, 3),
        p_MB=real("tree_p_MB", bodies, 3),
    )
    nothing = np.zeros((shapes, 3))
    made = Shapes(
        body=whole("shape_body", shapes),
        vertices=vertices,
        starts=starts,
        bulge=real("shape_bulge", shapes, 3, 3),
        radius=real("shape_radius", shapes),
        half_space=real("shape_half_space", shapes, 3),
        centre=nothing,
        axes=np.zeros((shapes, 3, 3)),
        half=nothing,
        disc=np.zeros(shapes),
    )
    problem = Problem(
        tree=tree,
        shapes=made,
        names=_words(arrays, "names", shapes),
        bodies=_words(arrays, "bodies", shapes),
        a=whole("a", pairs),
        b=whole("b", pairs),
        times=real("times", count),
        knots=knots,
        deviation=real("deviation", nq),
    )
    pair, segment, fraction = real("witness", 3).tolist()
    return Proof(
        lower=float(real("lower")),
        upper=float(real("upper")),
        problem=problem,
        pair=whole("plane_pair", planes),
        first=whole("plane_first", planes),
        last=whole("plane_last", planes),
        start=real("plane_start", planes),
        end=real("plane_end", planes),
        normals=real("plane_normals", planes, 2, 3),
        swept=whole("plane_swept", planes) != 0,
        witness=(int(pair), int(segment), fraction),
        weights=real("witness_weights", 4),
        vertices=whole("witness_vertices", 4, 2),
        balls=real("witness_balls", 4, 2, 3),
        hull_vertices=whole("witness_hull_vertices", hull, 2),
        hull_balls=real("witness_hull_balls", hull, 2, 3),
        off=real("witness_off", nq),
    )


def _array(arrays: dict[str, NDArray], name: str, kind: str, shape: tuple[int, ...]) -> NDArray:
    value = arrays.get(name)
    if value is None:
        raise InputError(f"{name} is missing")
    fits = value.ndim == len(shape) and all(
        want in (-1, have) for want, have in zip(shape, value.shape, strict=True)
    )
    if not fits or value.dtype.kind != kind:
        raise InputError(f"{name} of shape {value.shape} and type {value.dtype}; must be {shape}")
    if kind == "f" and not np.isfinite(value).all():
        raise InputError(f"{name}: not finite")
    return np.array(value, dtype=np.float64 if kind == "f" else np.int64, order="C")


def _words(arrays: dict[str, NDArray], name: str, count: int) -> tuple[str, ...]:
    value = arrays.get(name)
    if value is None or value.dtype.kind != "U" or value.shape != (count,):
        raise InputError(f"{name}: missing, or not {count} words")
    return tuple(value.tolist())
