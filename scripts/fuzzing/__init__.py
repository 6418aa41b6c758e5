"""Hostile input by seed: `damage` spoils files, `cases` lays them out, `worker` runs them, `campaign` judges."""
