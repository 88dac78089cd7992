"""A map that takes another one's place: made beside it, so that the old one is whole until then."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vnav.errors import MapError, VnavError
from vnav.io.store.map_folder import MapFolder, aside


def draft_of(folder: MapFolder) -> Path:
    """Where the map lies that is to take the place of another."""
    root = folder.root.resolve()
    return root.with_name(f".{root.name}.draft")


@contextmanager
def replacing(folder: MapFolder) -> Iterator[MapFolder]:
    """A map to fill, which takes the place of this one when the block ends without an error.

    It lies beside the old map, as ``.NAME.draft``. A VnavError deletes it; what an interruption
    leaves of it is there again the next time. Files of the old folder that are not vnav's are
    copied. MapError where nothing can be written beside the map, or it cannot be moved.
    """
    root, old, draft = folder.root.resolve(), aside(folder.root), draft_of(folder)
    try:
        yield MapFolder.create(draft, fresh=not (draft / "map.json").is_file())
    except VnavError:
        shutil.rmtree(draft, ignore_errors=True)
        raise
    for path in folder.foreign_files():
        copy = shutil.copytree if path.is_dir() else shutil.copy2
        copy(path, draft / path.name)
    shutil.rmtree(old, ignore_errors=True)
    try:
        root.rename(old)
        draft.rename(root)  # between the two, `MapFolder.open` brings the old map back
    except OSError as error:
        raise MapError(
            f"expected to put the new map in the place of {root}, found: {error.strerror}; it is"
            f" finished in {draft}"
        ) from error
    old.rename(draft)
    shutil.rmtree(draft, ignore_errors=True)
