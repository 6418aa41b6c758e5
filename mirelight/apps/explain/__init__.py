"""`mirelight explain`: the steps between two pictures of a job, one at a time. See docs/guides/compare.md."""
