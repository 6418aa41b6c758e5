"""Generator of the shipped scenes: procedural geometry and textures, ground truth, splats, proxies."""
