"""The page of a training shows every validation, escapes what it is told, and stands alone."""

from typing import Any

from swardmap.train.page import training_page

HISTORY: list[dict[str, Any]] = [
    {"step": 100, "loss": 1.7, "accuracy": 0.8, "grass_iou": 0.7, "obstacle_called_grass": 0.2},
    {"step": 200, "loss": 0.9, "accuracy": 0.9, "grass_iou": 0.8, "obstacle_called_grass": 0.05},
    {"step": 300, "loss": 0.8, "accuracy": 0.88, "grass_iou": None, "obstacle_called_grass": 0.06},
]


def test_every_validation_is_on_the_page() -> None:
    html = training_page("lawn <b>", HISTORY, 400, b"PNG", "swardmap train /home/me/recipe.yaml -o run")
    assert "How lawn &lt;b&gt; was trained" in html
    assert "300 of 400 steps, 3 validations" in html
    assert "best 0.9000 at step 200" in html
    assert "best 0.0500 at step 200" in html  # an error is best where it is small
    assert html.count("<svg") == 3  # shares have a curve, a loss above 1 has none
    assert html.count("<tr>") == 4
    assert "data:image/png;base64,UE5H" in html
    assert "/home/me" not in html
    assert "http" not in html.replace("http://www.w3.org/2000/svg", "")


def test_a_run_without_a_validation_is_a_page_too() -> None:
    assert "0 of 10 steps" in training_page("try", [], 10, None, "")
