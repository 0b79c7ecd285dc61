"""The table of a fleet, what is made of it, and how it is put into portions."""

from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.errors import UserError
from observer.fleet.batches import MOST_BYTES, MOST_ORDERS, batches
from observer.fleet.orders import Line, Order, given, orders_of, read_table
from tests.fleet.machines import RIG


def _table(folder: Path, text: str) -> Path:
    path = folder / "fleet.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_paths_go_out_from_the_table_and_other_columns_are_left_alone(tmp_path):
    path = _table(
        tmp_path, "hall,config,log,machine\n3,c/a.toml,../a/run.csv,lathe-7\n,/x.toml,/b.csv,lathe-8\n"
    )
    assert read_table(path) == [
        Line(tmp_path.parent / "a" / "run.csv", "lathe-7", tmp_path / "c" / "a.toml"),
        Line(Path("/b.csv"), "lathe-8", Path("/x.toml")),
    ]
    rows = [{"log": "../a/run.csv", "machine": "lathe-7", "config": "c/a.toml"}]
    parquet.write_table(pa.Table.from_pylist(rows), tmp_path / "fleet.parquet")
    assert read_table(tmp_path / "fleet.parquet") == read_table(path)[:1]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("log,machine\na.csv,m\n", "column config is missing"),
        ("log,machine,config\na.csv,,c.toml\n", "row 1: machine is empty"),
        ("log,machine,config\na.csv,m,c.toml\na.csv,../m,c.toml\n", "row 2: '../m' is no machine's name"),
        ("log,machine,config\na.csv,..,c.toml\n", "'..' is no machine's name"),
        ("log,machine,config\na.csv,m,c.toml\na.csv,m,c.toml\n", "row 2: a.csv of m stands there twice"),
        ("log,machine,config\n", "names no log"),
        ("log,machine,config\n\xff\0,\n".encode("latin-1").decode("latin-1"), "row 1: machine is empty"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_with_its_row(tmp_path, text, said):
    with pytest.raises(UserError, match=r"fleet\.csv: ") as told:
        read_table(_table(tmp_path, text))
    assert said in str(told.value)


def test_a_table_that_is_none(tmp_path):
    for name, content in (("a.csv", b"log,machine,config\n\xff\xfe"), ("a.parquet", b"no"), ("b.csv", None)):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError, match=name):
            read_table(tmp_path / name)


def test_logs_as_given_are_of_the_machine_of_their_configuration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert given([Path("a.csv")], RIG) == [Line(tmp_path / "a.csv", "rig-x", RIG)]


def test_a_replay_is_one_order_a_log_and_a_calibration_one_a_machine():
    c = Path("/c.toml")
    lines = [Line(Path(f"/{day}/run.csv.gz"), "m", c) for day in "ab"] + [Line(Path("/a/run.csv.gz"), "n", c)]
    singles = orders_of(lines, "replay")
    assert [order.logs for order in singles] == [(line.log,) for line in lines]
    assert singles[2].place == Path("n/replay/run")
    first, second = (order.place for order in singles[:2])
    assert first != second
    assert all(
        place.parent == Path("m/replay") and place.name.startswith("run-") for place in (first, second)
    )
    of_m, of_n = orders_of(lines, "calibrate")
    assert (of_m.place, of_m.logs) == (Path("m/calibrate"), (lines[0].log, lines[1].log))
    assert of_n.logs == (lines[2].log,)
    with pytest.raises(UserError, match="m has two configurations"):
        orders_of([lines[0], lines[1]._replace(config=Path("/d.toml"))], "discover")


def _orders(folder: Path, count: int, config: str, size: int = 10) -> list[Order]:
    found = []
    for i in range(count):
        log = folder / f"{config}-{i}.csv"
        log.write_bytes(b"x" * size)
        found.append(Order("m", log.stem, (log,), Path(config), Path("m", "replay", log.stem)))
    return found


def test_a_portion_is_of_one_configuration_and_every_order_is_in_one(tmp_path):
    orders = [
        o for pair in zip(_orders(tmp_path, 60, "a"), _orders(tmp_path, 60, "b"), strict=True) for o in pair
    ]
    portions = batches(orders, 2)
    assert all(len({order.config for order in portion}) == 1 for portion in portions)
    assert sorted((o for portion in portions for o in portion), key=str) == sorted(orders, key=str)
    assert max(map(len, portions)) == 15, "120 orders, 2 workers: four portions for each, at least"


def test_a_portion_is_bounded_in_orders_and_bytes(tmp_path):
    assert max(map(len, batches(_orders(tmp_path, 200, "a"), 1))) == MOST_ORDERS
    large = _orders(tmp_path, 3, "b", MOST_BYTES // 2 + 1)
    small = _orders(tmp_path, 1, "c")
    assert [len(portion) for portion in batches([*small, *large], 1)] == [1, 1, 1, 1]
    assert batches([*small, *large], 1)[-1] == tuple(small), "the largest come first"


def test_a_log_that_is_not_there_is_an_order_like_others(tmp_path):
    gone = Order("m", "gone", (tmp_path / "gone.csv",), Path("c"), Path("m/replay/gone"))
    assert batches([gone], 4) == [(gone,)]
