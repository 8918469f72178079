"""The drawings of the documentation are those that the code makes, and show what it does."""

import re
from xml.etree import ElementTree

import pytest

from joybridge.games.shooting_birds.game import NUMBERS
from joybridge.games.shooting_birds.sensing import RAYS
from tools.docs import drawings

pytestmark = pytest.mark.no_cover  # of tools, which are not measured


@pytest.mark.parametrize("name", drawings.DRAWINGS)
def test_a_drawing_is_up_to_date_small_and_has_colors_for_both_themes(name):
    drawn = drawings.DRAWINGS[name]()
    path = drawings.DOCS / name
    assert path.read_text(encoding="utf-8") == drawn, "run `python -m tools.docs.drawings`"
    root = ElementTree.fromstring(drawn)
    assert len(drawn) < 16_000 and root.get("aria-label")
    light, _, dark = drawings.STYLE.partition("@media (prefers-color-scheme: dark)")
    colors = set(re.findall(r"var\((--\w+)\)", drawn))
    assert colors == set(re.findall(r"(--\w+):", light)) == set(re.findall(r"(--\w+):", dark))


def test_the_drawing_of_the_approaches_names_every_output():
    words = re.findall(r">([^<]+)</text>", drawings.approaches())
    assert words.count("pressed above 0") == 2 and words.count("11 values, -1 to 1") == 2
    assert words.count("shoot / reload / none") == 2 and words.count("policy “buttons”") == 1


def test_the_drawing_of_the_rays_has_every_ray_and_what_the_sensor_reports():
    drawn = drawings.rays()
    assert drawn.count('class="thin"') == RAYS + 1  # one in the legend
    assert 3 < drawn.count('class="to-bird"') < RAYS and 3 < drawn.count('class="to-obstacle"') < RAYS
    values = sum(len(sensor.elements) for sensor in NUMBERS)
    assert f"under it: {values} values" in (drawings.DOCS / "paper.md").read_text()
