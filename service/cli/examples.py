"""Examples that the help of a command ends with."""

_ID = "01a20942-d407-7053-8f52-16b05c137715"
_EXAMPLES = {
    "serve": ("polhode serve --port 8000 --workers 4",),
    "worker": ("POLHODE_ENGINE=procrastinate polhode worker --slots 8",),
    "migrate": ("polhode migrate",),
    "validate": ("polhode validate examples/first.json", "polhode validate - --json < problem.json"),
    "solve": ("polhode solve examples/first.json --csv samples.csv", "polhode solve problem.json --json"),
    "atlas": ("polhode atlas problem.json --picture atlas.png",),
    "families": ("polhode families", "polhode families rational --json"),
    "sweep": (
        "polhode sweep examples/sweep.json --out points.parquet",
        "polhode sweep examples/sweep.json --remote --out points.csv",
    ),
    "calibrate": ("polhode calibrate --quick",),
    "compile": ("polhode compile",),
    "doctor": ("polhode doctor --sample 20",),
    "backup": ("polhode backup /backups/polhode-1.db",),
    "restore": ("polhode restore /backups/polhode-1.db",),
    "prune": ("polhode prune --samples-older-than 90d --dry-run",),
    "submit": ("polhode submit problem.json --wait", "sed s/-1/-2/ problem.json | polhode submit -"),
    "wait": (f"polhode wait {_ID} --seconds 60",),
    "show": (f"polhode show {_ID} --json",),
    "get": (
        f"polhode get {_ID} --out samples.parquet",
        f"polhode get {_ID} --start 1e6 --stop 1000010 --samples 11",
    ),
    "list": ("polhode list 'period<5, tier=high' --order -energy", "polhode list state=failed --of jobs"),
    "tag": (f"polhode tag {_ID} project=thesis figure=3",),
    "cancel": (f"polhode cancel {_ID}",),
}


def examples_of(name: str) -> str:
    """Return what the help of a command ends with; the mark keeps its lines as they are."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in _EXAMPLES[name])
