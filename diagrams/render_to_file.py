"""Off-screen: the arm at the end of a path in its scene, rendered to a PNG without a display.

python diagrams/render_to_file.py [--out end.png]
"""

import argparse
import sys
from pathlib import Path

from pydrake.systems.framework import DiagramBuilder

from pips_drake.scenarios import load_scenario
from pips_drake.serpentine.station import load_setup, make_plant
from pips_drake.twin.rendering import (
    add_renderer,
    corner_points,
    fit_view,
    render_available,
    render_view,
    save_png,
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("end.png"), help="file to write")
    out = parser.parse_args().out
    missing = render_available()
    if missing is not None:
        sys.exit(missing)

    scenario = load_scenario("trajectory_4").config
    setup = load_setup(scenario)
    builder = DiagramBuilder()
    plant, scene_graph, model = make_plant(builder, setup, scenario)
    add_renderer(scene_graph)
    diagram = builder.Build()

    context = diagram.CreateDefaultContext()
    end = setup.solver.solve(setup.path, [setup.path.length]).joints[0]
    plant.SetPositions(plant.GetMyContextFromRoot(context), model, end)
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    X_WC = fit_view(corner_points(query), direction=[0.8, 0.45, -0.6])
    save_png(render_view(query, X_WC), out)
    print(out)


if __name__ == "__main__":
    main()
