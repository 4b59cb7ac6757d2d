"""Evaluates a policy of one's own and prints its success rate with the 95 % interval, episode by episode. Needs genmanip.

    genmanip layout examples/tasks/012_pick_and_place.json --count 3 --out out/scenarios
    python examples/python/evaluate_with_interval.py out/scenarios
"""

import sys

import genmanip
from press import Press

check = genmanip.check_policy(Press, sys.argv[1], seconds=2.0)
print(check)
(result,) = genmanip.evaluate(sys.argv[1], Press, progress=lambda what, done, total: print(f"{what} {done}/{total}"))
print(result)
for row in result.results:
    print(row["id"], row["success"], row["failures"][:1])
