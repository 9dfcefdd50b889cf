"""A worker of an archive run: registers the drives that it receives (``python -m lgprjax.batch.worker DESCRIPTOR``).

The pool sends an ``ArchiveRun`` over a connection, which the worker answers with True or the reason why it cannot
begin, then pairs of a ``Job`` and the number of the attempt. Each is answered with numbers of scans as they are done,
and at last with None or the reason of a failure. The worker ends when the other end closes, so that none outlives its
pool by more than a drive.
"""

import sys
from multiprocessing.connection import Connection

from lgprjax.batch.jobs import DriveJobs
from lgprjax.errors import InputError


def main() -> None:
    """The program."""
    connection = Connection(int(sys.argv[1]))
    try:
        _serve(connection)
    except (EOFError, BrokenPipeError, ConnectionResetError, KeyboardInterrupt):
        return


def _serve(connection: Connection) -> None:
    try:
        jobs = DriveJobs(connection.recv())
    except InputError as error:
        connection.send(error)
        return
    try:
        connection.send(True)
        while True:
            job, attempt = connection.recv()
            connection.send(jobs.do(job, attempt, lambda scans: connection.send(int(scans))))
    finally:
        jobs.close()


if __name__ == "__main__":
    main()
