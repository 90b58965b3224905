"""Motors of a robot in a YAML file: {joint: {limit, gear, speed_limit, torque_speed, rotor_inertia}}, or null for no motor.

For example `FL_KFE: {torque_speed: [[0, 2.7], [20, 2.7], [50, 0]], gear: 9, rotor_inertia: 2.0e-6}`, a line a joint.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from rbd.errors import InputError, ModelError, nearest
from rbd.model.motors import Motor
from rbd.robots.loop_text import bytes_of, parsed

_FIELDS = tuple(field.name for field in fields(Motor))


def read_motor_file(path: Path) -> dict[str, Motor | None]:
    """{joint: its motor, or None}, for `robot.with_motors`.

    Raises:
        ModelError: no file, no YAML, or another content; the message has the joint.
    """
    if not path.is_file():
        raise ModelError(f"no file {str(path)!r:.200}; expected a YAML file of motors, {{joint: {{limit: 40}}}}.")
    given = parsed(path.name, bytes_of(path))
    if not isinstance(given, dict) or not all(isinstance(joint, str) for joint in given):
        raise ModelError(f"{path.name} holds {given!r:.80}; expected motors by their joints, {{joint: {{limit: 40}}}}.")
    out: dict[str, Motor | None] = {}
    for joint, data in given.items():
        if data is None:
            out[joint] = None
            continue
        if not isinstance(data, dict):
            raise ModelError(f"{path.name}: {joint!r:.80} is {data!r:.80}; expected {{limit: 40, gear: 9}}, or null.")
        for key in data:
            if key not in _FIELDS:
                known = nearest(str(key), _FIELDS)
                raise ModelError(f"{path.name}: {joint!r:.80} has {key!r:.80}, which motors have not; {known}.")
        try:
            out[joint] = Motor(**data)
        except InputError as error:
            raise ModelError(f"{path.name}: {joint!r:.80}: {error}") from None
    return out
