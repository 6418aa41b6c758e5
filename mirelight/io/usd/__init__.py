"""OpenUSD stages (.usd, .usda, .usdc, .usdz): splats, meshes, cameras and lights, read and written with the library.

The library may end its process on a damaged file, so a stage is read in a child process: ``child`` opens it there and
hands over plain arrays (``rows`` has their types), ``process`` starts it and takes them. ``take_*`` are the child's
parts, ``splats``, ``mesh``, ``cameras`` and ``lights`` ours. Everything comes in metres and Y up (``metersPerUnit``,
``upAxis``), and stands right to each other. Needs the extra `usd`.
"""

from __future__ import annotations
