"""The remote manipulator's station, and the parts that it is composed of."""

from pips_drake.remote_manipulator.station.attachments import AttachmentEvent, AttachmentMonitor
from pips_drake.remote_manipulator.station.plant import (
    PlantSettings,
    RemoteManipulatorPlant,
    make_plant,
)
from pips_drake.remote_manipulator.station.station import (
    JetConfig,
    MakeRemoteManipulatorStation,
    Station,
)

__all__ = [
    "AttachmentEvent",
    "AttachmentMonitor",
    "JetConfig",
    "MakeRemoteManipulatorStation",
    "PlantSettings",
    "RemoteManipulatorPlant",
    "Station",
    "make_plant",
]
