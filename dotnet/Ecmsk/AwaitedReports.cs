using System.Collections.Generic;
using System.Threading;
using System.Threading.Tasks;

namespace Ecmsk
{
    /// <summary>
    /// The reports of a board for <c>await foreach</c> of C# 8 and later, which takes any type with these members. The interface
    /// <c>IAsyncEnumerable</c> is not needed, which .NET Standard 2.0 has in a package of its own.
    /// </summary>
    public sealed class AwaitedReports
    {
        readonly Board board;
        readonly CancellationToken cancel;

        internal AwaitedReports(Board board, CancellationToken cancel)
        {
            this.board = board;
            this.cancel = cancel;
        }

        /// <summary>Begins with the next report.</summary>
        /// <returns>The enumerator, which one caller uses at a time.</returns>
        public Enumerator GetAsyncEnumerator()
        {
            return new Enumerator(board.Reports(cancel).GetEnumerator());
        }

        /// <summary>Gives report after report; the waits are in threads of the pool.</summary>
        public sealed class Enumerator
        {
            readonly IEnumerator<Snapshot> reports;

            internal Enumerator(IEnumerator<Snapshot> reports)
            {
                this.reports = reports;
            }

            /// <summary>The report that the last <see cref="MoveNextAsync"/> has found.</summary>
            public Snapshot Current
            {
                get { return reports.Current; }
            }

            /// <summary>Waits for the next report.</summary>
            /// <returns>Whether there is one; false once the sequence was cancelled. The task fails as
            /// <see cref="Board.Reports"/> does.</returns>
            public Task<bool> MoveNextAsync()
            {
                return Task.Run(() => reports.MoveNext());
            }

            /// <summary>Ends the sequence.</summary>
            /// <returns>A task that has ended.</returns>
            public Task DisposeAsync()
            {
                reports.Dispose();
                return Task.FromResult(true);
            }
        }
    }
}
