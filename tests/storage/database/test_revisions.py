"""The schemas that the migrations state are those that Alembic finds in them."""

from alembic.script import ScriptDirectory

from service.storage.database.migration import known_revisions, migrations_folder, newest_revision


def test_the_revisions_that_are_read_from_the_migrations_are_those_of_alembic():
    scripts = ScriptDirectory(str(migrations_folder()))
    assert known_revisions() == {script.revision for script in scripts.walk_revisions()}
    assert newest_revision() == scripts.get_current_head()
