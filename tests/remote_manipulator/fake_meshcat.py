"""A Meshcat's page without a browser: a test presses its keys."""
# ruff: noqa: N802 -- the names are Meshcat's

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Pad:
    """A gamepad's state, as Meshcat tells it."""

    index: int | None = None
    button_values: list[float] = field(default_factory=list)
    axes: list[float] = field(default_factory=list)


class FakeMeshcat:
    """Sliders and buttons that keep what they are given, rounded to their steps as Meshcat does."""

    def __init__(self) -> None:
        self.pad = Pad()
        self._sliders: dict[str, tuple[float, float, float]] = {}
        self._values: dict[str, float] = {}
        self._clicks: dict[str, int] = {}
        self.keys: dict[str, tuple[str, float]] = {}

    def AddSlider(self, name, low, high, step, value, less="", more=""):
        assert name not in self._sliders
        self._sliders[name] = low, high, step
        self._bind(less, name, -step)
        self._bind(more, name, step)
        return self.SetSliderValue(name, value)

    def SetSliderValue(self, name, value):
        low, high, step = self._sliders[name]
        value = min(max(value, low), high)
        self._values[name] = low + round((value - low) / step) * step
        return self._values[name]

    def GetSliderValue(self, name):
        return self._values[name]

    def AddButton(self, name, key=""):
        self._clicks[name] = 0
        self._bind(key, name, 0.0)

    def GetButtonClicks(self, name):
        return self._clicks[name]

    def GetGamepad(self):
        return self.pad

    def press(self, key: str) -> None:
        """What the browser does when a key goes down."""
        name, step = self.keys[key]
        if name in self._clicks:
            self._clicks[name] += 1
        else:
            self.SetSliderValue(name, self._values[name] + step)

    def _bind(self, key: str, name: str, step: float) -> None:
        assert key not in self.keys, f"{key} has two meanings"
        self.keys[key] = name, step
