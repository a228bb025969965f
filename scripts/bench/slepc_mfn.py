"""exp(−iH_l T) w by SLEPc's MFN, for peers.py.

Usage: slepc_mfn.py METHOD FILE.npz

peers.py starts it with the interpreter that SLEPc is installed for, which has its own NumPy. The
file holds S and K in CSR form, the start vector, T and the wavenumbers. The name of the result file
comes on standard input when it is time to begin. The script prints seconds and writes w_l(T).
"""

import glob
import sys
import time

# Where Debian and Ubuntu keep the complex build.
sys.path[:0] = sorted(
    glob.glob("/usr/lib/petscdir/*/*-complex/lib/python3/dist-packages") +
    glob.glob("/usr/lib/slepcdir/*/*-complex/lib/python3/dist-packages"))
import slepc4py

slepc4py.init([sys.argv[0]])
from petsc4py import PETSc
from slepc4py import SLEPc
import numpy as np


def main():
    if not np.issubdtype(PETSc.ScalarType, np.complexfloating):
        sys.exit("SLEPc is there, but for real numbers only")
    if sys.argv[1:] == ["--version"]:
        print(".".join(map(str, SLEPc.Sys.getVersion())))
        return
    method, path = sys.argv[1:]
    data = np.load(path)
    pointers, columns = data["indptr"], data["indices"]
    n = len(pointers) - 1
    start = PETSc.Vec().createSeq(n)
    start.setArray(data["start"])
    results = []
    print("ready", flush=True)
    target = sys.stdin.readline().strip()
    begin = time.perf_counter()
    for mu, tolerance in zip(data["mu"], data["tolerance"]):
        values = mu * data["S"] + 1j * data["K"]
        H = PETSc.Mat().createAIJ(size=(n, n),
                                  csr=(pointers, columns, values),
                                  comm=PETSc.COMM_SELF)
        mfn = SLEPc.MFN().create(comm=PETSc.COMM_SELF)
        mfn.setOperator(H)
        mfn.setType(method)
        function = mfn.getFN()
        function.setType(SLEPc.FN.Type.EXP)
        function.setScale(-1j * float(data["time"]), 1.0)
        mfn.setTolerances(float(tolerance), 10000)
        y = start.duplicate()
        mfn.solve(start, y)
        if mfn.getConvergedReason() < 0:
            sys.exit(
                f"SLEPc {method} did not converge at mu = {mu}: reason {mfn.getConvergedReason()}")
        results.append(y.getArray().copy())
        mfn.destroy()
        H.destroy()
    seconds = time.perf_counter() - begin
    np.save(target, np.array(results))
    print(seconds, flush=True)


main()
