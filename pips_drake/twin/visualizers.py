"""Shows a running diagram: in Meldis always, in Meshcat if there is one."""

from __future__ import annotations

from pydrake.geometry import (
    DrakeVisualizer,
    DrakeVisualizerParams,
    Meshcat,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
)
from pydrake.lcm import DrakeLcm
from pydrake.systems.framework import DiagramBuilder, OutputPort


def AddVisualizers(
    builder: DiagramBuilder,
    query: OutputPort,
    *,
    period: float,
    meshcat: Meshcat | None = None,
    lcm: DrakeLcm | None = None,
) -> None:
    """Adds what shows a scene graph while the diagram runs.

    Args:
        query: the scene graph's query port.
        period: between two pictures, s.
        meshcat: shows it too.
        lcm: where Meldis is told of it; Drake's default address without it.
    """
    # Meldis listens on LCM: it shows whatever runs.
    DrakeVisualizer.AddToBuilder(
        builder, query, lcm=lcm, params=DrakeVisualizerParams(publish_period=period)
    )
    if meshcat is not None:
        MeshcatVisualizer.AddToBuilder(
            builder, query, meshcat, MeshcatVisualizerParams(publish_period=period)
        )
