"""Where what happens from night to night is kept, in the project's root."""

from pathlib import Path

INBOX = Path("data/inbox")
ASIDE = Path("data/quarantine")
HISTORY = Path("history")
RUNS = HISTORY / "runs"
DECISIONS = HISTORY / "decisions"
LOG = HISTORY / "log.jsonl"
PAGE = HISTORY / "history.html"
MEASURED = HISTORY / "measured.jsonl"
STUDY = HISTORY / "study.json"
WHOLE = HISTORY / "report.html"
PLAN = HISTORY / "intake.json"
LOCK = HISTORY / "writer.lock"
STAGE_LOGS = HISTORY / "stages"
SHELF = Path("promoted")
METRICS = Path("reports/metrics.json")
REPORT = Path("reports/report.html")
DVC_CACHE = Path(".dvc/cache")
# A folder's motions.
MOTIONS = "motions.parquet"
