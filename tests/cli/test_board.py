import tomllib
from pathlib import Path


def test_board_prints_the_table_that_describes_it(slkit, tmp_path: Path):
    outcome = slkit("board", "checkerboard", "--page", "A4", "-o", tmp_path / "b.pdf")
    assert outcome.code == 0, outcome.err
    assert tomllib.loads(outcome.out) == {"printed": {"corners": [11, 8], "square_mm": 21.0}}
    assert (tmp_path / "b.pdf").read_bytes().startswith(b"%PDF")


def test_options_reach_the_drawing(slkit, tmp_path: Path):
    outcome = slkit(
        *("board", "charuco", "--portrait", "--corners", "5x7", "--square-mm", "25", "-o", tmp_path / "b.svg", "--json")
    )
    board = {"kind": "charuco", "squares": [6, 8], "square_mm": 25.0, "marker_mm": 18.0, "dictionary": "4x4_50"}
    assert outcome.json == {"printed": board, "file": str(tmp_path / "b.svg")}
    outcome = slkit("board", "border-marks", "--two-sided", "-o", tmp_path / "two.pdf")
    assert list(tomllib.loads(outcome.out)) == ["printed", "marks"]


def test_faults(slkit, tmp_path: Path):
    for arguments, words in (
        (("chess", "-o", "b.pdf"), "no board called 'chess'; there are: checkerboard"),
        (("marks", "-o", "b.png"), "as .pdf or .svg, not as .png"),
        (("marks", "--two-sided", "-o", "b.svg"), "an SVG has one page"),
        (("marks", "--page", "B5", "-o", "b.pdf"), "page must be one of A1"),
        (("checkerboard", "--corners", "11", "-o", "b.pdf"), "--corners must be a number in x and y, such as 11x8"),
        (("checkerboard", "--corners", "30x30", "--square-mm", "20", "-o", "b.pdf"), "must be 0.5 to 8.9 for"),
        (
            ("border-marks", "--square-mm", "60", "-o", "b.pdf"),
            "--square-mm must be 0.5 to 23.3 for border-marks on A3",
        ),
        (
            ("circles", "--square-mm", "nan", "-o", "b.pdf"),
            "--square-mm must be 0.5 to 30.1 for circles on A3 landscape, not nan",
        ),
    ):
        file = tmp_path / arguments[-1]
        outcome = slkit("board", *arguments[:-1], file)
        assert (outcome.code, outcome.out) == (2, "")
        assert words in outcome.err
        assert not list(tmp_path.iterdir())
