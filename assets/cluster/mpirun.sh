#!/bin/bash
# A command of raylift on so many processes of MPI, which write to one folder:
#   mpirun.sh 8 localize --scene scene.toml --out result
exec mpirun -np "$1" raylift "${@:2}" --shard auto --resume --threads 1
