from pathlib import Path

from vnav.config import SETTINGS, Config, FuseConfig, listing, load

ROOT = Path(__file__).parents[2]


def test_the_page_of_the_settings_is_current() -> None:
    made = "vnav config --markdown > docs/settings.md"
    assert (ROOT / "docs" / "settings.md").read_text("utf-8") == listing.markdown(), made
    assert made in listing.markdown()


def test_every_setting_has_a_row_with_all_that_is_known_of_it() -> None:
    rows = listing.rows()
    assert [row["name"] for row in rows] == list(SETTINGS)
    row = next(row for row in rows if row["name"] == "fuse.obstacle_min_m")
    assert row["allowed"] == "[0, 100], below robot_height_m"
    assert (row["default"], row["unit"]) == (0.1, "m")


def test_every_setting_is_listed_with_its_meaning() -> None:
    text = "\n".join(listing.lines())
    for name, setting in SETTINGS.items():
        assert f"\n  {name.rpartition('.')[2]} " in text
        assert f"\n      {setting.meaning}" in text


def test_changes_are_what_differs_from_the_defaults() -> None:
    assert listing.changes(Config()) == {}
    assert listing.changes(Config(seed=2, fuse=FuseConfig(voxel_m=0.1))) == {
        "seed": 2,
        "fuse.voxel_m": 0.1,
    }
    assert listing.changes(load("orb")) == {"features.front_end": "orb"}
