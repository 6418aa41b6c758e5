"""The benchmarks.

python scripts/bench PART [its options] [--quick] [--json FILE]
python scripts/bench tables     # the pages of docs/benchmarks, from the JSON files beside them
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # run as a folder, this one alone is on the path

from bench import pages

if __name__ == "__main__":
    if sys.argv[1:] != ["tables"]:
        sys.exit(__doc__)
    pages.write()
