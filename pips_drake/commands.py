"""The commands of `pips`: their options, and what each does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from pips_drake.command_report import (
    CHECK_LINES,
    DONE,
    FAILED,
    FOLLOW_LINES,
    INTERRUPTED,
    PLAN_LINES,
    SIMULATE_LINES,
    complain,
    print_margins,
    report,
)
from pips_drake.errors import InputError

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat


def _word(metavar: str) -> Any:
    """How the help calls what stands behind an option."""
    return tyro.conf.arg(metavar=metavar)


# A list a `--set`: without appending, a second one would silently replace the first.
_Overrides = Annotated[
    tyro.conf.UseAppendAction[list[list[str]]],
    tyro.conf.arg(name="set", metavar="KEY=VALUE ..."),
]


@dataclass(kw_only=True)
class Follow:
    """Solve follow-the-leader along a path: joints, actuator lengths, figures.

    Writes joints.csv, joints_in_deg.csv, spine_points.csv, actuators.csv, summary.json and figures.
    """

    path: Annotated[tyro.conf.Positional[str], _word("PATH")]
    """A shipped path (see `pips list`), a CSV with columns x_in,y_in,z_in or x_m,y_m,z_m, or a YAML
    list of lines and arcs. Row 1 is the base end of the straight line, row 2 the home tip."""
    arm: Annotated[str, _word("NAME")] = "prototype"
    """A shipped arm, or an arm file."""
    step_in: Annotated[float | None, _word("S")] = None
    """Spacing of the tip along the path, in. Without it the tip visits the path's own points."""
    tolerance_in: Annotated[float, _word("T")] = 1e-9
    """Spine error at which the iteration stops, in. Above 1e-9 in the report's mode: module lengths
    carry over from point to point (the report's own tolerance is 0.1)."""
    max_iterations: Annotated[int, _word("N")] = 50
    """Iteration limit a tip position; a point that needs more fails."""
    out: Annotated[Path | None, _word("DIR")] = None
    """Folder to write; out/follow_PATH by default."""
    force: bool = False
    """Replace an earlier result in that folder."""

    def run(self) -> int:
        from pips_drake.serpentine.runs.follow import follow

        verdict = follow(
            self.path,
            arm=self.arm,
            step_in=self.step_in,
            tolerance_in=self.tolerance_in,
            max_iterations=self.max_iterations,
            out=self.out or _default_folder("follow", self.path),
            force=self.force,
        )
        return report(verdict, FOLLOW_LINES)


@dataclass(kw_only=True)
class Check:
    """Judge a path in a scene without simulating: limits, clearance, forces, speeds."""

    path: Annotated[tyro.conf.Positional[str], _word("PATH")]
    """A shipped path, or a file as for `pips follow`. Corners of a table are blended by arcs."""
    arm: Annotated[str, _word("NAME")] = "prototype"
    """A shipped arm, or an arm file."""
    scene: Annotated[str | None, _word("NAME")] = None
    """A shipped scene, or a file of your own: *.dmd.yaml, *.sdf or *.urdf; `none` for no scene.
    Without it, the shipped scene of the path's name."""
    decompose: bool = False
    """Split the scene's meshes into convex parts; otherwise each collides as its convex hull."""
    mounting: Annotated[str, _word("NAME")] = "pad"
    """laboratory, pad or pad_below: how the arm's base stands."""
    corner_deviation_in: Annotated[float, _word("D")] = 0.25
    """How far a blended corner may pass from its point, in; 0 keeps the corners."""
    out: Annotated[Path | None, _word("DIR")] = None
    """Folder to write summary and figures to; nothing is written without it."""
    force: bool = False
    """Replace an earlier result in that folder."""

    def run(self) -> int:
        from pips_drake.config import validate
        from pips_drake.scenarios import find_own_scene
        from pips_drake.serpentine.runs.check import check, scene_of_path
        from pips_drake.serpentine.scenario import SerpentineScenario

        scene, scene_file = find_own_scene(self.scene or scene_of_path(self.path) or "none")
        scenario = SerpentineScenario(
            path=self.path,
            arm=self.arm,
            scene=scene,
            decompose_meshes=self.decompose,
            mounting=self.mounting,
            corner_deviation_in=self.corner_deviation_in,
        )
        validate(scenario)
        name = Path(self.path).stem
        verdict = check(scenario, name=name, out=self.out, force=self.force, scene_file=scene_file)
        return report(verdict, CHECK_LINES, own_scene=self.scene is not None)


@dataclass(kw_only=True)
class Plan:
    """Find a motion to a scenario's goals: tip path, joints, proved clearance, three views.

    The folder's simulate.yaml runs what was planned, as does `pips simulate SCENARIO`.
    """

    scenario: Annotated[tyro.conf.Positional[str], _word("SCENARIO")]
    """A shipped scenario that states goals (see `pips list`), or a YAML file."""
    goal: Annotated[tuple[float, float, float] | None, _word("X Y Z")] = None
    """Another goal than the scenario's, in frame 0, m; for no particular viewing direction."""
    out: Annotated[Path | None, _word("DIR")] = None
    """Folder to write; out/plan_SCENARIO by default."""
    overrides: _Overrides = field(default_factory=list)
    """Change fields of the scenario, such as snake.bending_stiffness_Nm2=1 alternatives=3."""
    scene: Annotated[str | None, _word("NAME")] = None
    """Another scene than the scenario's: a shipped one, or a file of your own: *.dmd.yaml, *.sdf or
    *.urdf; `none` for no scene."""
    force: bool = False
    """Replace an earlier result in that folder."""

    def run(self) -> int:
        from pips_drake.scenarios import load_scenario, plan

        loaded = load_scenario(self.scenario, _parse_overrides(self.overrides), scene=self.scene)
        out = self.out or Path("out") / f"plan_{loaded.name}"
        verdict = plan(loaded, out=out, force=self.force, goal=self.goal)
        return report(verdict, PLAN_LINES, own_scene=self.scene is not None)


@dataclass(kw_only=True)
class Simulate:
    """Simulate a scenario of any machine, and write its verdict, numbers, figures and replay."""

    scenario: Annotated[tyro.conf.Positional[str], _word("SCENARIO")]
    """A shipped scenario (see `pips list`), or a YAML file."""
    out: Annotated[Path | None, _word("DIR")] = None
    """Folder to write; out/SCENARIO by default."""
    overrides: _Overrides = field(default_factory=list)
    """Change fields of the scenario, such as motion.dwell_s=2 checks.clearance_min_mm=40."""
    scene: Annotated[str | None, _word("NAME")] = None
    """Another scene than the scenario's: a shipped one, or a file of your own: *.dmd.yaml, *.sdf or
    *.urdf; `none` for no scene."""
    decompose: bool = False
    """Split the scene's meshes into convex parts; otherwise each collides as its convex hull."""
    force: bool = False
    """Replace an earlier result in that folder."""
    meshcat: bool = False
    """Serve the run on localhost while it goes on, in any web browser."""

    def run(self) -> int:
        from pips_drake.scenarios import load_scenario, simulate

        loaded = load_scenario(
            self.scenario,
            _parse_overrides(self.overrides),
            scene=self.scene,
            decompose=self.decompose,
        )
        meshcat = _serve_meshcat() if self.meshcat else None
        out = self.out or Path("out") / loaded.name
        verdict = simulate(loaded, out=out, force=self.force, meshcat=meshcat)
        return report(verdict, SIMULATE_LINES, own_scene=self.scene is not None)


@dataclass(kw_only=True)
class Verify:
    """Re-check a proof of clearance from its planes alone, without any distance engine.

    `pips check --out` and `pips simulate` write proof_commanded.npz and proof_simulated.npz.
    """

    proof: Annotated[tyro.conf.Positional[Path], _word("PROOF")]
    """A proof file."""

    def run(self) -> int:
        from pips_drake.twin.certificate.verify import verify_proof

        checked = verify_proof(self.proof)
        print(f"{self.proof}: {'PROVED' if checked.proved else 'NOT PROVED'}")
        for failure in checked.failures:
            print(f"  {failure}")
        for name, words in (("scene", "to the scene"), ("own", "to itself")):
            if name in checked.groups:
                group = checked.groups[name]
                print(
                    f"  clearance {words}, claimed at least {group.lower * 1e3:.4g} mm, proved "
                    f"{group.proved_lower * 1e3:.4g} mm, reached {group.proved_upper * 1e3:.4g} mm"
                )
                print(
                    f"    {group.pair[0]} to {group.pair[1]} at {group.time:.3f} s; "
                    f"{group.pairs} pairs, {group.planes} planes"
                )
        return DONE if checked.proved else FAILED


@dataclass(kw_only=True)
class Study:
    """Compute a design study: a table and a figure of many variations of a scenario.

    One that was stopped, by whatever, goes on where it was when the same command is given again.
    """

    study: Annotated[tyro.conf.Positional[str], _word("STUDY")]
    """A shipped study (see `pips list`), or a YAML file."""
    out: Annotated[Path | None, _word("DIR")] = None
    """Folder to write; out/study_STUDY by default."""
    jobs: Annotated[int | None, _word("N")] = None
    """How many processes; as many as there are processors by default."""
    cluster: Annotated[str | None, _word("ADDRESS")] = None
    """Compute on a Dask cluster instead: its scheduler's address, such as tcp://host:8786."""
    force: bool = False
    """Start anew where there are results."""

    def run(self) -> int:
        from pips_drake.design_studies import study

        out = self.out or _default_folder("study", self.study)
        try:
            result = study(
                self.study, out=out, jobs=self.jobs, cluster=self.cluster, force=self.force
            )
        except KeyboardInterrupt:
            if not out.exists():
                raise
            words = f"interrupted; finished cases are kept in {out}: the same command goes on"
            return complain(words, INTERRUPTED)
        if "margins" in result.summary:
            print_margins(result.summary["margins"])
            print(f"  written to {result.folder}")
            return DONE
        for row in result.rows:
            name = f"{row['case']:>4}  {row.get('verdict') or row['status']:<6}"
            varied = result.summary["varied"]
            print(f"{name}  " + "  ".join(f"{key}={row[key]}" for key in varied))
            if row["reason"]:
                print(f"      {row['reason']}")
        print(f"  written to {result.folder}")
        return DONE


@dataclass(kw_only=True)
class View:
    """Show a model in the browser with a slider a joint (Drake's model visualizer)."""

    model: Annotated[tyro.conf.Positional[str], _word("MODEL")]
    """A shipped model (see `pips list`), or an SDF, URDF or MJCF file."""
    once: bool = False
    """Load and publish the model once, then stop: a check that it can be shown."""

    def run(self) -> int:
        from pips_drake.twin.model_viewer import view_model

        view_model(self.model, once=self.once)
        return DONE


@dataclass(kw_only=True)
class List:
    """List the shipped scenarios, studies, paths, arms, scenes and models."""

    def run(self) -> int:
        from pips_drake.design_studies import study_descriptions
        from pips_drake.scenarios import scenario_descriptions
        from pips_drake.scene.packages import list_names

        goals = scenario_descriptions(goals=True)
        motions = {
            name: text for name, text in scenario_descriptions().items() if name not in goals
        }
        for title, descriptions in (
            ("scenarios (pips simulate NAME)", motions),
            ("scenarios with goals (pips plan NAME, pips simulate NAME)", goals),
            ("studies (pips study NAME)", study_descriptions()),
        ):
            width = max(len(name) for name in descriptions)
            print(title)
            for name, text in descriptions.items():
                print(f"  {name:<{width}}  {text}")
        for kind, command in (
            ("path", "pips follow NAME, pips check NAME"),
            ("arm", "--arm NAME"),
            ("scene", "pips check PATH --scene NAME"),
            ("model", "pips view NAME"),
            ("cable robot", "the key `robot` of a scenario"),
        ):
            print(f"{kind}s ({command})")
            print("  " + "  ".join(list_names(kind)))
        return DONE


@dataclass(kw_only=True)
class Export:
    """Write an arm as SDF, URDF or MJCF, generated from its arm file."""

    arm: Annotated[tyro.conf.Positional[str], _word("ARM")]
    """A shipped arm, or an arm file."""
    format: Annotated[str | None, _word("WORD")] = None
    """sdf, urdf or mjcf (MuJoCo). Without it, what the suffix of --out says; else sdf."""
    mounting: Annotated[str | None, _word("NAME")] = None
    """laboratory, pad or pad_below: how the arm's base stands in an MJCF; laboratory by default. In
    the other formats, whoever loads the file says where it stands."""
    out: Annotated[Path | None, _word("FILE")] = None
    """File to write; ARM.sdf, ARM.urdf or ARM.xml (MJCF) in the current folder by default."""
    force: bool = False
    """Replace an existing file."""

    def run(self) -> int:
        from pips_drake.serpentine.arm import load_arm
        from pips_drake.serpentine.export import choose_format, make_export
        from pips_drake.twin.output_folder import write_whole

        kind = choose_format(self.format, self.out)
        arm = load_arm(self.arm)
        text = make_export(arm, kind, mounting=self.mounting)
        file = self.out or Path(f"{arm.name}{kind.value}")
        if file.exists() and not self.force:
            raise InputError(f"{file} exists; use --force to replace it")
        if file.is_dir():
            raise InputError(f"{file}: is a folder; must be a file")
        if not file.parent.is_dir():
            raise InputError(f"{file.parent}: no such folder")
        write_whole(file, text)
        print(file)
        return DONE


Command = (
    Annotated[Follow, tyro.conf.subcommand("follow")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Plan, tyro.conf.subcommand("plan")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Verify, tyro.conf.subcommand("verify")]
    | Annotated[Study, tyro.conf.subcommand("study")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[List, tyro.conf.subcommand("list")]
    | Annotated[Export, tyro.conf.subcommand("export")]
)


def _default_folder(command: str, name: str) -> Path:
    return Path("out") / f"{command}_{Path(name).stem}"


def _parse_overrides(groups: Sequence[Sequence[str]]) -> dict[str, str]:
    overrides = {}
    for word in (word for group in groups for word in group):
        key, equals, value = word.partition("=")
        if not (key and equals):
            raise InputError(f"--set {word}: must be KEY=VALUE, such as motion.dwell_s=2")
        overrides[key] = value
    return overrides


def _serve_meshcat() -> Meshcat:
    from pips_drake.twin.replay import make_meshcat

    meshcat = make_meshcat()
    print(f"Meshcat: {meshcat.web_url()}")
    return meshcat
