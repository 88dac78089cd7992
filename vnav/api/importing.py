"""Recordings of other programs become captures."""

from pathlib import Path

from vnav.api.arguments import AnyPath
from vnav.core.progress import Progress, silent
from vnav.io.recordings.importing import ImportedCapture, import_recording
from vnav.io.recordings.ros_topics import TopicNames


def import_capture(
    source: AnyPath,
    folder: AnyPath,
    *,
    color: str | None = None,
    depth: str | None = None,
    camera_info: str | None = None,
    registered: bool = False,
    fixed_frame: str | None = None,
    progress: Progress = silent,
) -> ImportedCapture:
    """Write a recording of ROS (.bag, .mcap, a bag folder) into a new capture folder.

    ``color``, ``depth``, ``camera_info``: topics, where they are not found by their types.
    ``registered``: depth lies on the pixels of colour, though frames do not say so.
    ``fixed_frame``: of the poses, where the recording has some. VnavError where nothing can be
    made of it; nothing is left then.
    """
    named = TopicNames(color, depth, camera_info, registered)
    return import_recording(Path(source), Path(folder), named, fixed_frame, progress)
