"""The views that others are held against, with their masks as these are known."""

from bisect import bisect_left, bisect_right

from vnav.masking.view import MaskedView

SPACING_S = 0.18  # at least, between two views


class ViewHistory:
    """Some of the views of one track, in the order of time."""

    def __init__(self) -> None:
        self._views: list[MaskedView] = []

    def add(self, newest: MaskedView) -> None:
        """Take a view, unless it is too near to the last."""
        if not self._views or newest.view.stamp_s - self._views[-1].view.stamp_s >= SPACING_S:
            self._views.append(newest)

    def replace(self, masked: MaskedView) -> None:
        """Take a view's new mask, where the view is among these."""
        k = bisect_left(self._views, masked.view.stamp_s, key=_stamp_s)
        if k < len(self._views) and _stamp_s(self._views[k]) == masked.view.stamp_s:
            self._views[k] = masked

    def between(self, begin_s: float, end_s: float) -> list[MaskedView]:
        """The views after a time and before another."""
        first = bisect_right(self._views, begin_s, key=_stamp_s)
        return self._views[first : bisect_left(self._views, end_s, key=_stamp_s)]

    def forget(self, until_s: float) -> None:
        """Drop the views before a time."""
        del self._views[: bisect_left(self._views, until_s, key=_stamp_s)]


def _stamp_s(masked: MaskedView) -> float:
    return masked.view.stamp_s
