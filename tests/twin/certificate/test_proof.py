"""Proof files: they say what was found, and nothing that is false passes the check."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pips_drake.errors import InputError
from pips_drake.twin.certificate.certify import ClearanceCertificate
from pips_drake.twin.certificate.proof import load_proof, make_proof, save_proof
from pips_drake.twin.certificate.search import certify
from pips_drake.twin.certificate.verify import check_proof, verify_proof


@pytest.fixture(scope="module")
def certificate(random_machine, random_walk) -> ClearanceCertificate:
    rng = np.random.default_rng(3)
    machine, scene, own = random_machine(rng, moving_obstacle=True)
    knots = random_walk(rng, machine, 4, 0.1)
    return ClearanceCertificate(
        scene=certify(machine.problem(scene, knots)), own=certify(machine.problem(own, knots))
    )


@pytest.fixture
def proof(certificate):
    return make_proof(certificate.scene)


def changed(proof, **changes):
    """A proof with other values in it; those of the problem, tree and shapes by their names."""
    problem = proof.problem
    for part, prefix in (("tree", "tree_"), ("shapes", "")):
        own = {
            key.removeprefix(prefix): value
            for key, value in changes.items()
            if key in [prefix + name for name in getattr(problem, part)._fields]
        }
        problem = dataclasses.replace(problem, **{part: getattr(problem, part)._replace(**own)})
        changes = {k: v for k, v in changes.items() if k.removeprefix(prefix) not in own}
    mine = {field.name for field in dataclasses.fields(problem)}
    problem = dataclasses.replace(problem, **{k: v for k, v in changes.items() if k in mine})
    return dataclasses.replace(
        proof, problem=problem, **{k: v for k, v in changes.items() if k not in mine}
    )


def test_what_is_written_is_proved_when_it_is_read(tmp_path: Path, certificate) -> None:
    save_proof(tmp_path / "proof.npz", certificate)
    report = verify_proof(tmp_path / "proof.npz")
    assert report.proved and report.failures == ()
    assert set(report.groups) == {"scene", "own"}
    for name, group in report.groups.items():
        made = getattr(certificate, name)
        assert (group.lower, group.upper) == (made.lower, made.upper)
        # What the search takes off for rounding (1e-9 m) is not taken off here.
        assert group.lower <= group.proved_lower <= group.lower + 1.1e-9
        assert group.proved_upper == pytest.approx(group.upper, abs=1e-12)
        assert group.pair == made.witness.bodies
        assert group.time == made.witness.time
        assert (group.pairs, group.planes) == (len(made.problem.a), len(made.planes.pair))


def test_the_same_certificate_gives_the_same_bytes(tmp_path: Path, certificate) -> None:
    for name in ("one", "two"):
        save_proof(tmp_path / name, certificate)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_a_file_reads_back_as_it_was(tmp_path: Path, certificate, proof) -> None:
    save_proof(tmp_path / "proof.npz", certificate)
    read = load_proof(tmp_path / "proof.npz")["scene"]
    assert np.array_equal(read.normals, proof.normals)
    assert np.array_equal(read.problem.knots, proof.problem.knots)
    assert read.problem.bodies == proof.problem.bodies
    assert read.witness == proof.witness


def test_a_higher_bound_than_the_planes_prove_is_caught(proof) -> None:
    report = check_proof(changed(proof, lower=proof.lower + 1e-8))
    assert len(report.failures) == 1
    assert report.failures[0].startswith("planes prove 0.")


def test_a_lower_witness_than_its_points_is_caught(proof) -> None:
    report = check_proof(changed(proof, upper=proof.upper - 1e-8))
    assert report.failures[0].startswith("witness proves 0.")


def test_every_plane_is_needed(proof) -> None:
    keep = np.arange(len(proof.pair)) != 5
    some = {
        name: getattr(proof, name)[keep]
        for name in ("pair", "first", "last", "start", "end", "normals", "swept")
    }
    pair = proof.pair[5]
    assert check_proof(changed(proof, **some)).failures[0] == (
        f"pair {pair} has no plane for some instant"
    )


def test_a_gap_between_parts_is_caught(proof) -> None:
    end = proof.end.copy()
    single = int(np.flatnonzero((proof.last - proof.first == 1) & ~proof.swept)[0])
    end[single] -= 1e-9
    failures = check_proof(changed(proof, end=end)).failures
    assert f"pair {proof.pair[single]} has no plane for some instant" in failures


def test_normals_count(proof) -> None:
    turned = proof.normals.copy()
    turned[0] = -turned[0]
    assert check_proof(changed(proof, normals=turned)).failures
    longer = proof.normals * 1.001
    assert check_proof(changed(proof, normals=longer)).failures == (
        "not so: normals are unit vectors",
    )


def nearest(proof) -> tuple[int, int]:
    """The witness's shapes."""
    p = proof.witness[0]
    return int(proof.problem.a[p]), int(proof.problem.b[p])


def test_a_larger_body_than_was_proved_is_caught(proof) -> None:
    for s in nearest(proof):
        radius = proof.problem.shapes.radius.copy()
        radius[s] += 1e-6
        report = check_proof(changed(proof, radius=radius))
        assert report.proved_lower < proof.lower
        assert report.failures
        bulge = proof.problem.shapes.bulge.copy()
        bulge[s] += 1e-5 * np.eye(3)
        assert check_proof(changed(proof, bulge=bulge)).proved_lower < proof.lower


def test_another_motion_than_was_proved_is_caught(proof) -> None:
    knots = proof.problem.knots.copy()
    segment = proof.witness[1]
    moved = 0
    for j in range(6):
        for step in (-1e-4, 1e-4):
            other = knots.copy()
            other[segment, j] += step
            moved += bool(check_proof(changed(proof, knots=other)).failures)
    assert moved >= 2  # the joints that move the nearest pair at all, one way or the other
    faster = knots.copy()
    faster[1:-1] = knots[1:-1][::-1]
    assert check_proof(changed(proof, knots=faster)).failures


def test_joint_errors_that_were_not_proved_are_caught(proof) -> None:
    deviation = proof.problem.deviation.copy()
    deviation[:6] = 1e-4
    report = check_proof(changed(proof, deviation=deviation))
    assert report.failures and report.proved_lower < proof.lower


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("weights", np.array([1.5, -0.5, 0.0, 0.0]), "the witness is on its bodies"),
        ("balls", np.full((4, 2, 3), 0.9), "the witness is on its bodies"),
        ("off", 1e-3, "the witness is within the deviation"),
        ("witness", (0, 99, 0.0), "the witness is on the path"),
        ("tree_parent", -1, "bodies come after their parents"),
        ("tree_kind", 7, "joints are of known kinds"),
        ("tree_start", 99, "positions exist"),
        ("tree_start", 0, "each position moves one joint"),
        ("tree_R_PF", 1.01, "frames are rotations"),
        ("tree_axis", 1.01, "axes are unit vectors"),
        ("radius", -0.1, "radii are not negative"),
        ("a", 99, "pairs are of shapes"),
    ],
)
def test_what_makes_no_sense_is_said(proof, field, value, sentence) -> None:
    problem, name = proof.problem, field.removeprefix("tree_")
    owners = (problem.tree,) if field != name else (proof, problem, problem.shapes)
    old = next(getattr(owner, name) for owner in owners if hasattr(owner, name))
    if np.isscalar(value):
        value = old * value if field in ("tree_R_PF", "axis") else np.full_like(old, value)
    assert f"not so: {sentence}" in check_proof(changed(proof, **{field: value})).failures


def test_a_proof_of_something_else_is_caught(tmp_path: Path, certificate) -> None:
    save_proof(tmp_path / "proof.npz", certificate)
    mine = {"scene": certificate.scene.problem, "own": certificate.own.problem}
    assert verify_proof(tmp_path / "proof.npz", mine).proved
    other = changed(make_proof(certificate.scene), knots=mine["scene"].knots + 1e-3).problem
    report = verify_proof(tmp_path / "proof.npz", mine | {"scene": other})
    assert report.failures == ("scene: positions differ from the proof's",)
    radius = mine["own"].shapes.radius + 1e-3
    other = changed(make_proof(certificate.own), radius=radius).problem
    report = verify_proof(tmp_path / "proof.npz", {"own": other})
    assert "own: shape shape_0 of body_1 differs from the proof's" in report.failures
    fewer = dataclasses.replace(mine["own"], a=mine["own"].a[1:], b=mine["own"].b[1:])
    assert verify_proof(tmp_path / "proof.npz", {"own": fewer}).proved  # it proves more
    save_proof(tmp_path / "scene.npz", ClearanceCertificate(scene=certificate.scene, own=None))
    report = verify_proof(tmp_path / "scene.npz", mine)
    assert report.failures == ("own: no proof of this group",)


def test_files_that_are_no_proofs_are_refused(tmp_path: Path, certificate) -> None:
    file = tmp_path / "proof.npz"
    with pytest.raises(InputError, match="no such file"):
        verify_proof(file)
    file.write_text("nonsense")
    with pytest.raises(InputError, match="not a proof"):
        verify_proof(file)
    np.savez(file, version=np.array(1), values=np.array([{}], dtype=object))
    with pytest.raises(InputError, match="not a proof"):  # objects would have to be unpickled
        verify_proof(file)
    np.savez(file, version=np.array(99))
    with pytest.raises(InputError, match="not a proof of version 1"):
        verify_proof(file)
    np.savez(file, version=np.array(1))
    with pytest.raises(InputError, match="proves nothing"):
        verify_proof(file)
    save_proof(file, certificate)
    with np.load(file) as packed:
        arrays = {name: packed[name] for name in packed.files}
    for name, value, message in (
        ("scene.knots", None, "scene: knots is missing"),
        ("scene.knots", np.zeros((2, 2)), r"scene: knots of shape \(2, 2\)"),
        ("scene.plane_normals", np.full((3, 2, 3), "x"), "scene: plane_normals of shape"),
        ("scene.lower", np.array(np.nan), "scene: lower: not finite"),
        ("own.names", np.array(["a"]), "own: names: missing, or not 10 words"),
    ):
        other = {k: v for k, v in arrays.items() if k != name}
        np.savez(file, **other, **({} if value is None else {name: value}))
        with pytest.raises(InputError, match=message):
            verify_proof(file)
    data = (tmp_path / "proof.npz").read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match="not a proof"):
        verify_proof(file)
