import numpy as np
import pytest

from slkit.calibration.tags import find_charuco, find_tags
from slkit.targets import AprilTags, Charuco, TagMarks

from .pictures import mapped, seen, tilted

CHARUCO = Charuco((9, 7), 30.0, 21.0)
TAGS = AprilTags((4, 3), 60.0, 18.0)
MARKS = TagMarks(((-185.0, -120.0), (185.0, -120.0), (185.0, 120.0), (-185.0, 120.0)), 40.0)


def rms(away: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean((away**2).sum(axis=1))))


@pytest.mark.parametrize("tilt_deg", [5.0, 40.0])
def test_charuco_corners(tilt_deg: float, rng: np.random.Generator):
    homography = tilted(CHARUCO, rng, tilt_deg)
    found = find_charuco(seen(CHARUCO, homography, rng), CHARUCO)
    assert found is not None and found.shape == (6, 8, 2)
    away = found.reshape(-1, 2) - mapped(homography, CHARUCO.points())
    assert np.isfinite(away).all()
    assert rms(away) < 0.03


def test_a_part_of_a_charuco_board(rng: np.random.Generator):
    homography = tilted(CHARUCO, rng, 20.0)
    cut = seen(CHARUCO, homography, rng)[:, 330:].copy()
    found = find_charuco(cut, CHARUCO)
    assert found is not None
    away = found.reshape(-1, 2) + [330, 0] - mapped(homography, CHARUCO.points())
    there = np.isfinite(away[:, 0])
    assert 0.3 < there.mean() < 0.8
    assert np.abs(away[there]).max() < 0.15
    # Corners that lie outside the picture are not invented.
    assert not there[mapped(homography, CHARUCO.points())[:, 0] < 330].any()


def test_no_charuco_board(rng: np.random.Generator):
    noise = rng.integers(0, 255, (300, 400)).astype(np.uint8)
    assert find_charuco(noise, CHARUCO) is None
    homography = tilted(CHARUCO, rng, 10.0)
    other = Charuco((9, 7), 30.0, 21.0, "6x6_50")
    assert find_charuco(seen(CHARUCO, homography, rng), other) is None


@pytest.mark.parametrize("target", [TAGS, MARKS], ids=["grid", "marks"])
@pytest.mark.parametrize("tilt_deg", [5.0, 40.0])
def test_corners_of_tags(target: AprilTags | TagMarks, tilt_deg: float, rng: np.random.Generator):
    homography = tilted(target, rng, tilt_deg)
    found = find_tags(seen(target, homography, rng), target)
    assert found is not None
    away = found - mapped(homography, target.points())
    assert np.isfinite(away).all()
    # Cells of a tag are three px small here when it is tilted.
    assert rms(away) < (0.02 if tilt_deg < 10 else 0.04)


def test_a_hidden_tag_is_left_out_and_the_others_keep_their_places(rng: np.random.Generator):
    homography = tilted(TAGS, rng, 15.0)
    picture = seen(TAGS, homography, rng)
    x, y = mapped(homography, TAGS.centers())[5].astype(int)
    picture[y - 50 : y + 50, x - 50 : x + 50] = 128
    found = find_tags(picture, TAGS)
    assert found is not None
    hidden = np.arange(48) // 4 == 5
    assert np.isnan(found[hidden]).all()
    assert np.abs(found - mapped(homography, TAGS.points()))[~hidden].max() < 0.1


def test_a_number_seen_twice_is_not_trusted(rng: np.random.Generator):
    marks = TagMarks(((0.0, 0.0), (100.0, 0.0)), 40.0)
    homography = tilted(marks, rng, 5.0, size=(600, 300))
    once = seen(marks, homography, rng, size=(600, 300))
    found = find_tags(np.concatenate([once, once]), marks)
    assert found is None


def test_no_tags():
    assert find_tags(np.full((200, 300), 90, np.uint8), TAGS) is None
