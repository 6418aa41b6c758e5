"""A job made ready, and what makes its frames: the stages, keys, requirements, and the cache of what is kept."""
