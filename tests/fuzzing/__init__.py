"""Hostile input by seed: `damage` spoils what is `sound`, `cases` lays it out, `worker` runs it, `campaign` judges."""
