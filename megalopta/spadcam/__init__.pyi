from .capturing import (
    CaptureSettings as CaptureSettings,
    State as State,
    capture as capture,
)
from .clock import (
    Clock as Clock,
    ClockFit as ClockFit,
)
from .emulated import EmulatedCamera as EmulatedCamera
from .link import (
    Arrived as Arrived,
    Link as Link,
    LinkLostError as LinkLostError,
    Plugged as Plugged,
    Unplugged as Unplugged,
)
from .nominal import (
    named_sensor as named_sensor,
    sensor_as_set as sensor_as_set,
)
from .plate import Plate as Plate
from .port import (
    UDEV_RULE as UDEV_RULE,
    UsbPort as UsbPort,
    find_port as find_port,
    open_port as open_port,
    port_lines as port_lines,
    usb_ports as usb_ports,
)
from .recording import (
    Connection as Connection,
    Recording as Recording,
    RecordingSettings as RecordingSettings,
    open_recording as open_recording,
)
from .recovering import (
    Recovered as Recovered,
    recover as recover,
)
from .rendered import Rendered as Rendered
from .replay import Told as Told
from .stimuli import (
    Flat as Flat,
    Stimulus as Stimulus,
)
from .terminal import (
    EmulatedPort as EmulatedPort,
    Faults as Faults,
)
from .view import (
    recorded_line as recorded_line,
    status_line as status_line,
    viewing as viewing,
)
