"""Pictures without a screen: what is drawn is what is in the recording, where the viewer would put it."""

from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.viewer import chart, heatmap, stream
from klute_sim.viewer.picture import picture, render, render_scene, rrd_reader
from klute_sim.viewer.picture.rrd_reader import Container, Entity, RrdContents, View
from klute_sim.viewer.stream import BLUE, RED, SeriesLine
from tests.command_line import run

rr = pytest.importorskip("rerun")

TIME = np.linspace(0.0, 2.0, 21)
LOOP = chart.Chart(
    "loop",
    "length [mm]",
    "force [N]",
    (
        chart.ChartCurve("round", BLUE, np.cos(np.pi * TIME), np.sin(np.pi * TIME)),
        chart.ChartCurve("far", RED, np.array([-4.0, 4.0]), np.array([0.0, 2.0])),
    ),
)
MAP = heatmap.Heatmap(
    "map", "time [s]", np.linspace(0.0, 2.0, 3), ("a", "b"), np.array([[0.0, 4.0], [np.nan, 2.0]]), 4.0, "sd"
)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    import rerun.blueprint as rrb

    def layout() -> Any:
        words = stream.build_text_view("page", "page")
        left = rrb.Vertical(
            stream.build_plot_view("wave [N]", ["wave"]), chart.build_view(LOOP, "loop"), row_shares=[3, 1]
        )
        tabs = rrb.Tabs(heatmap.build_view(MAP, "map"), words)
        body = rrb.Spatial3DView(origin="world", name="body")
        return stream.build_window_blueprint(rrb.Horizontal(left, tabs, body, column_shares=[2, 1, 1]), "time")

    path = tmp_path_factory.mktemp("picture") / "r.rrd"
    with stream.open_recording(path, "test", ["one"], layout) as out:
        axis = rr.TimeColumn("time", duration=TIME)
        stream.send_lines(out, axis, [SeriesLine("wave", "a wave", RED, 2.0, np.sin(TIME))])
        chart.log_chart(out, LOOP, axis, (np.cos(np.pi * TIME), np.sin(np.pi * TIME)))
        heatmap.log_heatmap(out, MAP)
        stream.log_text(
            out, "page", "# Title\n\nSome words.\n\n" + stream.format_markdown_table(["name", "value"], [["x", 1.25]])
        )
        turn = rr.Transform3D(translation=[0.0, 0.0, 0.5], quaternion=[0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])
        out.log("world/bone", turn, static=True)
        out.log("world/bone/rod", rr.Capsules3D(lengths=[0.4], radii=[0.05], colors=[RED]), static=True)
    return path


@pytest.fixture(scope="module")
def found(file: Path) -> RrdContents:
    return rrd_reader.read_rrd(file)


def view(found: RrdContents, name: str) -> View:
    return next(each for each in rrd_reader.iter_views(found.root) if each.name == name)


def axis_of(found: RrdContents, name: str, at: float = 0.5) -> Any:
    return picture.build_view_figure(found, view(found, name), at).axes[0]


def test_the_layout_reads_back(found: RrdContents) -> None:
    assert found.timeline == "time"
    assert isinstance(found.root, Container)
    assert (found.root.kind, found.root.shares) == ("row", (2.0, 1.0, 1.0))
    left, tabs, body = found.root.children
    assert isinstance(left, Container)
    assert isinstance(tabs, Container)
    assert (left.kind, left.shares, tabs.kind) == ("column", (3.0, 1.0), "tabs")
    assert [each.name for each in rrd_reader.iter_views(found.root)] == ["wave [N]", "loop", "map", "page", "body"]
    assert [each.kind for each in (*left.children, body)] == ["TimeSeries", "2D", "3D"]  # type: ignore[union-attr]


def test_a_series_is_drawn_as_it_is(found: RrdContents) -> None:
    axis = axis_of(found, "wave [N]")
    line, cursor = axis.lines
    assert line.get_xdata() == pytest.approx(TIME, abs=1e-9)
    assert np.array_equal(line.get_ydata(), np.sin(TIME))
    assert line.get_label() == "a wave"
    assert line.get_color()[:3] == pytest.approx(np.array(RED) / 255.0)
    assert set(cursor.get_xdata()) == {0.5}


def test_a_chart_is_to_scale_and_its_mark_is_at_the_cursor(found: RrdContents) -> None:
    axis = axis_of(found, "loop", at=0.5)
    places = [(text.get_text(), *text.get_position()) for text in axis.texts]
    assert {"round", "far", "across: length [mm], up: force [N]"} <= {name for name, _, _ in places}
    across = {name: x for name, x, y in places if chart.FRAME_HEIGHT < y < chart.FRAME_HEIGHT + 10.0}
    assert across["4"] - across["2"] == pytest.approx(2.0 * chart.FRAME_WIDTH / 8.8, rel=0.01)
    (mark,) = axis.collections[-1].get_offsets()
    # Half a second into the round is at the top of it: no length, and 1 N of -1.15 to 2.15.
    assert mark[0] == pytest.approx(across["0"], abs=0.01)
    assert mark[1] == pytest.approx(chart.FRAME_HEIGHT * 1.15 / 3.3, abs=0.01)


def test_a_map_has_its_colours_where_its_numbers_are(found: RrdContents) -> None:
    pixels = render.decode_image(view(found, "map").select_entities(found.entities)["map/map"])
    high, wide = pixels.shape[:2]
    quarter, rest = (high // 4, 3 * high // 4), (wide // 4, 3 * wide // 4)
    corners = [tuple(pixels[y, x]) for y in quarter for x in rest]
    expected = [
        heatmap.COLOUR_SCALE[0],
        heatmap.COLOUR_SCALE[-1],
        heatmap.MISSING_VALUE_COLOUR,
        heatmap.COLOUR_SCALE[2],
    ]
    assert corners == [tuple(colour) for colour in expected]
    (drawn_image,) = axis_of(found, "map").images
    assert drawn_image.get_extent() == [0.0, chart.FRAME_WIDTH, chart.FRAME_HEIGHT, 0.0]


def test_words_are_said_without_their_marks(found: RrdContents) -> None:
    said = [text.get_text() for text in axis_of(found, "page").texts]
    assert said[0] == "Title"
    assert "Some words." in said
    assert said.index("x     1.25") == said.index("name  value") + 1


def test_a_body_is_drawn_where_it_is_and_turned(found: RrdContents) -> None:
    (rod,) = axis_of(found, "body").patches
    # A quarter turn about y takes what points up to what points forward.
    (left, low), (right, high) = rod.get_xy().min(axis=0), rod.get_xy().max(axis=0)
    assert (left, right, low, high) == pytest.approx((-0.05, 0.45, 0.45, 0.55), abs=1e-6)


def test_what_is_rounded_is_the_hull_of_circles() -> None:
    shape = render_scene.compute_outline(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.1)
    assert shape.min(axis=0) == pytest.approx([-0.1, -0.1])
    assert shape.max(axis=0) == pytest.approx([1.1, 0.1])


def test_a_value_is_the_last_one_before_the_cursor() -> None:
    entity = Entity()
    entity.rows["x"], entity.times["time"] = ["a", "b", "c"], [np.array([0.0, 1.0, 2.0])]
    assert [entity.get_value("x", "time", place) for place in (-1.0, 0.5, 1.0, 9.0)] == ["a", "a", "b", "c"]
    entity.static["y"] = ["always"]
    assert entity.get_value("y", "time", 0.5) == ["always"]


def test_pictures_are_written_whole_and_view_by_view(file: Path, tmp_path: Path) -> None:
    done = run("view", str(file), "--picture", str(tmp_path / "whole.png"), "--at", "0.5")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / "whole.png")]
    pixels = matplotlib.image.imread(tmp_path / "whole.png")
    assert pixels.shape[1] == round(picture.WINDOW_SIZE_IN[0] * picture.DPI)
    assert pixels[..., :3].std() > 0.03
    done = run("view", str(file), "--picture", str(tmp_path / "views"))
    names = ["01-wave.png", "02-loop.png", "03-map.png", "04-page.png", "05-body.png"]
    assert [Path(line).name for line in done.stdout.splitlines()] == names
    assert sorted(path.name for path in (tmp_path / "views").iterdir()) == names


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--at", "1"], "--at goes with --picture"),
        (["--web", "--picture", "p.png"], "--web and --picture exclude each other"),
        (["--picture", ""], "the path is empty"),
    ],
)
def test_options_that_do_not_go_together_are_one_sentence(arguments: list[str], says: str, file: Path) -> None:
    done = run("view", str(file), *arguments)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_what_is_no_recording_of_ours_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "bad.rrd").write_bytes(b"nonsense")
    with pytest.raises(InputError, match="cannot be read"):
        rrd_reader.read_rrd(tmp_path / "bad.rrd")
    bare = rr.RecordingStream("else", recording_id="1")
    bare.save(tmp_path / "bare.rrd")
    bare.log("x", rr.Scalars(1.0))
    bare.disconnect()
    with pytest.raises(InputError, match="has no layout"):
        rrd_reader.read_rrd(tmp_path / "bare.rrd")


def test_other_kinds_of_pictures_are_refused_and_leave_no_folder(tmp_path: Path) -> None:
    for name in ("q.jpg", "q.PDF"):
        with pytest.raises(InputError, match=r"pictures are drawn as PNG; give a file that ends in \.png, or a folder"):
            picture.save_pictures(tmp_path / "none.rrd", tmp_path / name)
    assert not list(tmp_path.iterdir())
