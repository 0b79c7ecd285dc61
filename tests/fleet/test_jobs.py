"""The table of a fleet, what is made of it, and how it is put into portions."""

from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import parquet

from observer.errors import UserError
from observer.fleet.jobs import Job, TableRow, jobs_of, read_table, rows_of_logs
from observer.fleet.run import MOST_JOBS, batches
from tests.logs.machines import RIG as RIG_FOLDER

RIG = RIG_FOLDER / "config.toml"


def _table(folder: Path, text: str) -> Path:
    path = folder / "fleet.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with logs and a configuration, which are looked for and not read."""
    for name in ("c.toml", "a.csv", "b.csv", "day/1.csv", "day/2.csv", "day/odd[1].csv", "day/notes/x"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_paths_go_out_from_the_table_and_other_columns_are_left_alone(folder):
    (folder / "tables").mkdir()
    text = f"hall,config,log,machine\n3,../c.toml,../day/1.csv,lathe-7\n,{folder}/c.toml,{folder}/b.csv,l-8\n"
    path = _table(folder / "tables", text)
    expected = [
        TableRow(folder / "day" / "1.csv", "lathe-7", folder / "c.toml"),
        TableRow(folder / "b.csv", "l-8", folder / "c.toml"),
    ]
    assert read_table(path) == expected
    rows = [{"log": "../day/1.csv", "machine": "lathe-7", "config": "../c.toml"}]
    parquet.write_table(pa.Table.from_pylist(rows), folder / "tables" / "fleet.parquet")
    assert read_table(folder / "tables" / "fleet.parquet") == expected[:1]


@pytest.mark.parametrize(
    "text",
    [
        "\ufefflog,machine,config\na.csv,m,c.toml\n",
        "log;machine;config\r\na.csv;m;c.toml\r\n;;\r\n",
        "log\tmachine\tconfig\na.csv\tm\tc.toml",
        "log, machine, config\n\na.csv, m, c.toml\n\n",
        'log,machine,config\n"a.csv",m,./c.toml\n',
    ],
)
def test_a_table_may_be_as_spreadsheets_write_it(folder, text):
    assert read_table(_table(folder, text)) == [TableRow(folder / "a.csv", "m", folder / "c.toml")]


def test_a_pattern_selects_the_files_that_match(folder):
    lines = read_table(_table(folder, "log,machine,config\nday/*,m,c.toml\n?.csv,n,c.toml\n"))
    names = ["day/1.csv", "day/2.csv", "day/odd[1].csv", "a.csv", "b.csv"]
    assert [line.log for line in lines] == [folder / name for name in names]
    (line,) = read_table(_table(folder, "log,machine,config\nday/odd[1].csv,m,c.toml\n"))
    assert line.log == folder / "day/odd[1].csv", "a file of that very name comes first"


HEAD = "log,machine,config\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "Empty CSV file"),
        ("log,machine\na.csv,m\n", "column config is missing"),
        ("file,machine,config\na.csv,m,c.toml\n", "column log is missing; .* says file, machine, config"),
        ("log,log,machine,config\na.csv,b.csv,m,c.toml\n", "column log is there twice"),
        (f"{HEAD}a.csv,,c.toml\n", "row 1: machine is empty"),
        (f"{HEAD}a.csv,m\n", "Expected 3 columns, got 2"),
        (
            f"{HEAD}a.csv,m,c.toml\nx, y.csv,m,c.toml\n",
            "Row #3: Expected 3 columns, got 4: .* a cell with a comma in quotes",
        ),
        (f"{HEAD}a.csv,m,c.toml\na.csv,../m,c.toml\n", r"row 2: '\.\./m' is not a valid machine name"),
        (f"{HEAD}a.csv,..,c.toml\n", r"'\.\.' is not a valid machine name"),
        (f"{HEAD}a.csv,report.html,c.toml\n", r"'report\.html' is not a valid machine name"),
        (f"{HEAD}a.csv,m,c.toml\nday/../a.csv,m,c.toml\n", "row 2: .* of m is there twice, in row 1"),
        (f"{HEAD}a.csv,m,c.toml\n*.csv,m,c.toml\n", r"row 2: .*a\.csv of m is there twice, in row 1"),
        (f"{HEAD}a.csv,m,c.toml\na.csv,n,c.toml\n", "row 2: .* by the same configuration of m in row 1"),
        (f"{HEAD}a.csv,m,no.toml\n", r"row 1: config: /.*/no\.toml is not there"),
        (f"{HEAD}a.csv,m,day\n", "row 1: config: .*day is a folder"),
        (f"{HEAD}day/,m,c.toml\n", r"row 1: log: .*day is a folder; name its logs, as day/\*\.csv"),
        (f"{HEAD}day/*.txt,m,c.toml\n", r"row 1: log: no file matches /.*day/\*\.txt"),
        (
            f"{HEAD}x.csv,m,c.toml\ny.csv,m,c.toml\n",
            r"none of its 2 logs exists, for instance /.*/x\.csv for one",
        ),
        (HEAD, "names no log"),
        (f'{HEAD}"a.csv,m,c.toml\n', "give the table as .parquet or as CSV in UTF-8"),
    ],
)
def test_an_error_in_a_table_is_reported_with_its_row(folder, text, said):
    with pytest.raises(UserError, match=rf"fleet\.csv: .*{said}"):
        read_table(_table(folder, text))


def test_a_log_that_is_not_there_beside_others_is_work_that_fails(folder):
    lines = read_table(_table(folder, f"{HEAD}a.csv,m,c.toml\nx.csv,m,c.toml\n"))
    assert [line.log.name for line in lines] == ["a.csv", "x.csv"]


def test_one_log_may_be_of_two_machines_by_a_configuration_each(folder):
    (folder / "d.toml").touch()
    lines = read_table(_table(folder, f"{HEAD}a.csv,mill-x,c.toml\na.csv,mill-z,d.toml\n"))
    assert [line.machine for line in lines] == ["mill-x", "mill-z"]


def test_a_table_that_cannot_be_read_is_reported_with_its_name(tmp_path):
    for name, content in (("a.csv", b"log,machine,config\n\xff\xfe"), ("a.parquet", b"no"), ("b.csv", None)):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(UserError, match=name):
            read_table(tmp_path / name)


def test_logs_as_given_are_of_the_machine_of_their_configuration(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert rows_of_logs([Path("a.csv")], RIG) == [TableRow(tmp_path / "a.csv", "rig-x", RIG)]
    with pytest.raises(UserError, match=r"a\.csv: named 2 times"):
        rows_of_logs([Path("a.csv"), Path("./a.csv")], RIG)


def test_a_replay_is_one_order_a_log_and_a_calibration_one_a_machine():
    c = Path("/c.toml")
    lines = [TableRow(Path(f"/{day}/run.csv.gz"), "m", c) for day in "ab"] + [
        TableRow(Path("/a/run.csv.gz"), "n", c)
    ]
    singles = jobs_of(lines, "replay")
    assert [order.logs for order in singles] == [(line.log,) for line in lines]
    assert singles[2].folder == Path("n/replay/run")
    first, second = (order.folder for order in singles[:2])
    assert first == jobs_of(lines[:1], "replay")[0].folder  # what is done is not done again for a namesake
    assert second.parent == Path("m/replay")
    assert second.name.startswith("run-")
    of_m, of_n = jobs_of(lines, "calibrate")
    assert (of_m.folder, of_m.logs) == (Path("m/calibrate"), (lines[0].log, lines[1].log))
    assert of_n.logs == (lines[2].log,)
    with pytest.raises(UserError, match="m has two configurations"):
        jobs_of([lines[0], lines[1]._replace(config=Path("/d.toml"))], "discover")


def test_a_portion_is_of_one_configuration_and_every_order_is_in_one():
    orders = [
        Job("m", f"{config}{i}", (Path(f"{config}-{i}.csv"),), Path(config), Path(f"m/replay/{config}{i}"))
        for i in range(60)
        for config in "ab"
    ]
    portions = batches(orders, 4)
    assert all(len({order.config for order in portion}) == 1 for portion in portions)
    assert sorted((o for portion in portions for o in portion), key=str) == sorted(orders, key=str)
    assert max(map(len, portions)) == 8, "120 orders, 4 workers: four portions for each, at least"


def test_a_portion_is_bounded_in_orders():
    of_log = [Job("m", f"r{i}", (Path(f"{i}.csv"),), Path("a"), Path(f"m/replay/r{i}")) for i in range(200)]
    assert max(map(len, batches(of_log, 1))) == MOST_JOBS
    of_machine = Job("m", "calibrate", (Path("1.csv"), Path("2.csv")), Path("a"), Path("m/calibrate"))
    assert batches([of_machine, of_machine], 1) == [(of_machine,), (of_machine,)]
