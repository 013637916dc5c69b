from .capturing import CaptureSettings, State, capture
from .clock import Clock, ClockFit
from .emulated import EmulatedCamera
from .link import Arrived, Link, LinkLostError, Plugged, Unplugged
from .nominal import named_sensor, sensor_as_set
from .port import UDEV_RULE, UsbPort, find_port, open_port, port_lines, usb_ports
from .recording import Connection, Recording, RecordingSettings, open_recording
from .stimuli import Flat, Plate, Rendered, Stimulus
from .terminal import EmulatedPort, Faults
from .view import status_line, viewing

__all__ = [
    "UDEV_RULE",
    "Arrived",
    "CaptureSettings",
    "Clock",
    "ClockFit",
    "Connection",
    "EmulatedCamera",
    "EmulatedPort",
    "Faults",
    "Flat",
    "Link",
    "LinkLostError",
    "Plate",
    "Plugged",
    "Recording",
    "RecordingSettings",
    "Rendered",
    "State",
    "Stimulus",
    "Unplugged",
    "UsbPort",
    "capture",
    "find_port",
    "named_sensor",
    "open_port",
    "open_recording",
    "port_lines",
    "sensor_as_set",
    "status_line",
    "usb_ports",
    "viewing",
]
