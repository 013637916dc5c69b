from .drawing import (
    check_plan as check_plan,
    configuration_of as configuration_of,
    repeated as repeated,
    repeated_name as repeated_name,
    sequence_name as sequence_name,
    split_of as split_of,
)
from .model import (
    FlowFile as FlowFile,
    Plan as Plan,
    load_plan as load_plan,
)
