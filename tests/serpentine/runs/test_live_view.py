"""What a viewer is told while a run goes on."""

from pydrake.lcm import DrakeLcm

from pips_drake.serpentine.runs.run import run_station
from pips_drake.serpentine.scenario import SerpentineScenario
from pips_drake.serpentine.station import load_setup
from pips_drake.twin.replay import make_meshcat


def _short_scenario():
    return SerpentineScenario(path="trajectory_4_arcs", scene="trajectory_4", duration_s=0.25)


def test_meldis_is_told_the_shapes_once_and_the_poses_16_times_a_second():
    scenario = _short_scenario()
    lcm = DrakeLcm("memq://")
    heard: dict[str, int] = {}

    def count(channel: str):
        lcm.Subscribe(channel, lambda _: heard.update({channel: heard.get(channel, 0) + 1}))

    for channel in ("DRAKE_VIEWER_LOAD_ROBOT", "DRAKE_VIEWER_DRAW"):
        count(channel)
    run_station(scenario, load_setup(scenario), lcm=lcm)
    while lcm.HandleSubscriptions(0):
        pass
    # A quarter of a second holds samples 0 to 4 at 1/16 s; Initialize() may add one of its own.
    assert heard["DRAKE_VIEWER_LOAD_ROBOT"] == 1
    assert 5 <= heard["DRAKE_VIEWER_DRAW"] <= 6


def test_meshcat_shows_arm_scene_and_actuators():
    scenario = _short_scenario()
    meshcat = make_meshcat()
    run_station(scenario, load_setup(scenario), meshcat=meshcat)
    assert "localhost" in meshcat.web_url()
    for path in ("prototype/segment_8", "payload/payload", "pallet/pallet", "L3_tube"):
        assert meshcat.HasPath(f"/drake/visualizer/{path}"), path
