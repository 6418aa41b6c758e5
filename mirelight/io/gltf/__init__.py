"""glTF 2.0 and GLB: the container, and the parts of it that relighting needs.

``document`` opens a file and hands out bytes; ``accessors`` turns them into arrays; ``nodes`` places things in the
world; ``geometry``, ``materials``, ``lights``, ``cameras`` and ``animation`` read one kind of thing each; ``scene``
puts them together; ``write`` makes files. Specification: Khronos glTF 2.0.1 (ISO/IEC 12113), referred to as "glTF §".
"""

from __future__ import annotations
