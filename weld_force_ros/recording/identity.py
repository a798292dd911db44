"""The identity of a recording: a number that its files and `metadata.yaml` hold, whatever its folder is called."""

import uuid
from pathlib import Path

from weld_force_ros.recording.mcap_reader import McapFile
from weld_force_ros.recording.reader import listed_files, metadata_of, series_of
from weld_force_ros.recording.rosbag2_format import FileForm, stated_origin

KEY = "weld_force_ros.recording_id"
"""The entry of rosbag2's custom data that holds it."""


def identity_in(form: FileForm) -> str | None:
    """Return the identity that a recording states; None if it is not of this suite, or older than identities."""
    return dict(form.custom_data).get(KEY)


def with_identity(form: FileForm) -> FileForm:
    """Return the form with an identity: its own, or a new one."""
    if identity_in(form):
        return form
    return form._replace(custom_data=(*form.custom_data, (KEY, str(uuid.uuid4()))))


def recording_in(directory: Path) -> tuple[FileForm, str] | None:
    """Return form of the recording of this suite in a folder, and the name that its files share; None without one.

    It is known by metadata.yaml or, where that is lost, by what its files state.

    Raises:
        OSError: the folder or a file cannot be read.
    """
    if origin := stated_origin(metadata_of(directory)):
        form = FileForm(ros_distro=origin[0], custom_data=origin[1])
        if identity_in(form):
            return form, series_of(next(reversed(listed_files(directory)), directory.resolve().name))
    for path in directory.glob("*.mcap"):
        form = McapFile(path).stated_form()
        if identity_in(form):
            return form, series_of(path.name)
    return None
