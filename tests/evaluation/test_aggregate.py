"""Several sequences as one, by hand and through the program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from uppm.cli.main import app
from uppm.core.errors import InputError
from uppm.evaluation.aggregate import aggregate, read_results


def result(method: str, points: int, accuracy: float, pq: float | None, switches: int) -> dict[str, object]:
    return {
        "method": method,
        "ground_truth_points": points,
        "accuracy_cm": accuracy,
        "pq_3d": pq,
        "id_switches": switches,
        "seed": 0,
        "aligned": False,
        "source": "a.uppm",
    }


def test_by_hand() -> None:
    found = aggregate(
        [result("ours", 300, 1.0, 0.5, 3), result("ours", 100, 2.0, None, 4), result("other", 100, 5.0, 0.1, 0)]
    )
    assert found == {
        "ours": {
            "sequences": 2,
            "ground_truth_points": 400,
            "accuracy_cm": pytest.approx(1.25),
            "pq_3d": 0.5,
            "id_switches": 7,
        },
        "other": {
            "sequences": 1,
            "ground_truth_points": 100,
            "accuracy_cm": 5.0,
            "pq_3d": pytest.approx(0.1),
            "id_switches": 0,
        },
    }


def test_through_the_program(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps({"results": [result("ours", 300, 1.0, 0.5, 3)]}))
    (tmp_path / "b.json").write_text(json.dumps(result("ours", 100, 2.0, None, 4)))
    arguments = ["evaluate", "aggregate", str(tmp_path / "a.json"), str(tmp_path / "b.json")]
    found = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert found["accuracy_cm"] == pytest.approx(1.25)
    assert found["sequences"] == 2
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0
    assert "1.250" in shown.stdout


def test_chart(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="needs `pip install uppm[eval]`")
    (tmp_path / "a.json").write_text(json.dumps([result("ours", 3, 1.0, 0.5, 3), result("other", 3, 2.0, 0.4, 3)]))
    written = CliRunner().invoke(app, ["evaluate", "aggregate", str(tmp_path / "a.json"), "-o", str(tmp_path / "out")])
    assert written.exit_code == 0, written.output
    assert "image/svg+xml" in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "expected the report.json"),
        ("[]", "found no results"),
        ('{"results": []}', "found no results"),
        ("3", "found other JSON"),
        ('[{"method": "a"}]', "found no ground_truth_points for a"),
    ],
)
def test_other_files(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=said) as error:
        read_results(tmp_path / "a.json")
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="no such file"):
        read_results(tmp_path / "none.json")
