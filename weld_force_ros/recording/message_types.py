"""Definitions of message types where a recording has none, or has them in another language than `.msg`."""

from weld_force_ros.recording.rosbag2_format import STRING, MessageDefinition


def msg_text(definition: MessageDefinition) -> str:
    """Return the definition of a message type in the form `ros2msg`.

    One that is missing, or is written as IDL, is that of the type of this name in ROS: of std_msgs/String always, of
    others if `rosbags` is installed and the type's hash, if there is one, is the same.

    Raises:
        ValueError: the type is unknown here.
    """
    if definition.schema_encoding == "ros2msg" and definition.text.strip():
        return definition.text
    if definition.name == STRING.name:
        return STRING.text
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError(
            f"no definition of {definition.name}; pip install 'weld_force_ros[foreign]' knows those of ROS"
        ) from None
    store = get_typestore(Stores.ROS2_JAZZY)
    if definition.name not in store.fielddefs or definition.type_hash not in (
        "",
        store.hash_rihs01(definition.name),
    ):
        if definition.schema_encoding == "ros2msg":  # a type without fields has an empty definition
            return definition.text
        raise ValueError(f"no definition of {definition.name}")
    text, _ = store.generate_msgdef(definition.name, ros_version=2)
    return text
