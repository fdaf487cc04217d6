"""Writes ``migrations/new_file.sql``: what all migrations together make of an empty SQLite file.

``python -m tests.support.new_file``, after a migration was added.
"""

import sqlite3
import tempfile
from pathlib import Path

from service.storage.database.new_file import END, SCRIPT
from service.storage.database.revisions import migrations_folder
from tests.support.databases import upgrade_to, url_of


def schema_of(file: Path) -> list[str]:
    """Return the statements that make a file's tables and indexes, in the order in which it has them."""
    connection = sqlite3.connect(file)
    found = connection.execute(
        "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY rowid"
    ).fetchall()
    connection.close()
    return [sql for (sql,) in found]


def revision_of(file: Path) -> str:
    connection = sqlite3.connect(file)
    ((found,),) = connection.execute("SELECT version_num FROM alembic_version").fetchall()
    connection.close()
    return str(found)


def migrated(folder: Path) -> Path:
    """Return a new file on which every migration has run."""
    file = folder / "migrated.db"
    upgrade_to(url_of(file), "head")
    return file


def statements_of(file: Path) -> list[str]:
    """Return what makes a file like this one, without its rows."""
    version = f"INSERT INTO alembic_version (version_num) VALUES ('{revision_of(file)}')"
    return [*schema_of(file), version]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        text = "".join(each + END for each in statements_of(migrated(Path(folder))))
    (migrations_folder() / SCRIPT).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
