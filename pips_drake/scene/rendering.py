"""Whether Drake can render pictures here.

Drake's wheel loads EGL from the system. Without it `MakeRenderEngineVtk` raises; with EGL but no
driver behind it (Mesa's software one, for example) rendering crashes the interpreter (measured on
drake 1.51). So look here first.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from typing import Any

_PLATFORM_DEVICE_EXT = 0x313F  # EGL_PLATFORM_DEVICE_EXT, from the extension EGL_EXT_platform_device
_MOST_DEVICES = 16


@functools.cache
def can_render() -> bool:
    """Whether one of EGL's devices, software ones included, gives a display: what VTK asks for.

    Elsewhere than on Linux Drake needs nothing from the system, and the answer is yes.
    """
    if sys.platform != "linux":
        return True
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    pointer, integer = ctypes.c_void_p, ctypes.c_int
    query_devices = _function(egl, b"eglQueryDevicesEXT", integer, integer, pointer, pointer)
    get_display = _function(egl, b"eglGetPlatformDisplayEXT", pointer, integer, pointer, pointer)
    initialize = _function(egl, b"eglInitialize", integer, pointer, pointer, pointer)
    if not (query_devices and get_display and initialize):
        return False
    devices, count = (pointer * _MOST_DEVICES)(), integer(0)
    query_devices(_MOST_DEVICES, devices, ctypes.byref(count))
    displays = [get_display(_PLATFORM_DEVICE_EXT, d, None) for d in devices[: count.value]]
    return any(initialize(display, None, None) for display in displays if display)


def _function(egl: ctypes.CDLL, name: bytes, result: Any, *arguments: Any) -> Any:
    """A function of EGL or of its extensions; None if this EGL does not have it."""
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    address = egl.eglGetProcAddress(name)
    return ctypes.CFUNCTYPE(result, *arguments)(address) if address else None
