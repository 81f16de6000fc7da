// An open board: its frames. What it is commanded to do stands in Calls.cs.

using System;
using System.Collections.Generic;
using System.Threading;
using System.Threading.Tasks;

namespace Ecmsk
{
    /// <summary>The arguments of <see cref="Board.StateChanged"/>.</summary>
    public sealed class StateChangedEventArgs : EventArgs
    {
        internal StateChangedEventArgs(StateByte before, Snapshot snapshot)
        {
            Before = before;
            Snapshot = snapshot;
        }

        /// <summary>The state in the report before.</summary>
        public StateByte Before { get; private set; }

        /// <summary>The first report with the new state.</summary>
        public Snapshot Snapshot { get; private set; }
    }

    /// <summary>An open board. Threads may share it.</summary>
    /// <remarks>
    /// Opening and disposing send nothing: a board in OP goes on. A board makes one report in each cycle. Each report goes to all
    /// calls that wait for one then. The link keeps 32 reports that nobody has read, and drops the oldest first.
    /// </remarks>
    public sealed partial class Board : IDisposable
    {
        // [OURS] Reports that are read at most to find the size of a slot.
        const int ProbeReports = 3;

        readonly Native native;
        readonly BoardHandle handle;
        readonly BoardOptions options;
        volatile Slave[] slaves = new Slave[0];
        volatile int cycleUs = 1000;
        bool isVirtual;

        Board(Native native, BoardHandle handle, BoardOptions options)
        {
            this.native = native;
            this.handle = handle;
            this.options = options;
        }

        /// <summary>The version of NEXTWUSBLib, for example <c>0.1.0</c>.</summary>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib for this process.</exception>
        public static string LibraryVersion
        {
            get { return Native.Need().Version(); }
        }

        /// <summary>The file of NEXTWUSBLib that is in use; its name alone if the system found it by that.</summary>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib for this process.</exception>
        public static string LibraryFile
        {
            get { return Native.Need().File; }
        }

        /// <summary>Opens the board at a link's URI and leaves it in its present state: nothing is sent.</summary>
        /// <param name="uri">Such as <c>usb:</c>, <c>tcp://host</c> or <c>sim:?slaves=drive*2</c> (docs/LINKS.md).</param>
        /// <param name="options">Limits of waits; null: those by default.</param>
        /// <returns>The board.</returns>
        /// <exception cref="ArgumentNullException">There is no URI.</exception>
        /// <exception cref="EcmskException">
        /// The URI is not valid, there is no such board or it is in use, it makes no report, or its slot size is not known.
        /// </exception>
        /// <exception cref="DllNotFoundException">There is no NEXTWUSBLib for this process.</exception>
        public static Board Open(string uri, BoardOptions options = null)
        {
            if (uri == null)
                throw new ArgumentNullException("uri");
            if (uri.IndexOf('\0') >= 0)
                throw new ArgumentException("a link's URI has no character of value 0; remove it", "uri");
            Native native = Native.Need();
            IntPtr pointer;
            native.Check(native.Open(Native.Text(uri), out pointer));
            var board = new Board(native, new BoardHandle(native, pointer), (options ?? new BoardOptions()).Copy());
            try
            {
                board.Begin();
                return board;
            }
            catch
            {
                board.Dispose();
                throw;
            }
        }

        void Begin()
        {
            LinkName = NameOfLink();
            isVirtual = LinkName.Contains("clock=virtual");
            SlotSize = options.SlotSize ?? SizeInLink() ?? SizeByCrc();
            Next("opening", options.ReadLimit, CancellationToken.None, 0);
        }

        /// <summary>
        /// Closes the board. Calls of other threads end with <see cref="ErrorKind.Closed"/>. Nothing is sent: the board goes on
        /// executing its FIFO, and axes stay on. It may be called again.
        /// </summary>
        public void Dispose()
        {
            handle.Dispose();
        }

        /// <summary>Whether the board was disposed of.</summary>
        public bool IsClosed
        {
            get { return handle.HasEnded; }
        }

        /// <summary>The URI of the link in its normal form.</summary>
        public string LinkName { get; private set; }

        /// <summary>The size of the slots of the board's frames.</summary>
        public SlotSize SlotSize { get; private set; }

        /// <summary>
        /// A report has another state than the one before. It is raised by the call that has read the report, in its thread. An
        /// exception of a handler ends that call.
        /// </summary>
        public event EventHandler<StateChangedEventArgs> StateChanged;

        /// <summary>Waits for the next report. Those with a wrong CRC are discarded and counted.</summary>
        /// <param name="limit">
        /// How long; null: <see cref="BoardOptions.ReadLimit"/>; <see cref="Timeout.InfiniteTimeSpan"/>: without an end. On a
        /// link with virtual time it is the board's time.
        /// </param>
        /// <param name="cancel">Ends the wait within 50 ms.</param>
        /// <returns>The report.</returns>
        /// <exception cref="EcmskException">None has come in time, or the board is lost or closed.</exception>
        /// <exception cref="OperationCanceledException"><paramref name="cancel"/> has ended the wait.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public Snapshot Read(TimeSpan? limit = null, CancellationToken cancel = default(CancellationToken))
        {
            Snapshot snapshot = Next("the next cycle", limit ?? options.ReadLimit, cancel, NewestSequence);
            cancel.ThrowIfCancellationRequested();
            return snapshot;
        }

        /// <summary>As <see cref="Read"/>, in a thread of the pool.</summary>
        /// <param name="limit">As for <see cref="Read"/>.</param>
        /// <param name="cancel">As for <see cref="Read"/>.</param>
        /// <returns>The report.</returns>
        public Task<Snapshot> ReadAsync(TimeSpan? limit = null, CancellationToken cancel = default(CancellationToken))
        {
            return Task.Run(() => Read(limit, cancel), cancel);
        }

        /// <summary>Reads report after report.</summary>
        /// <param name="cancel">Ends the sequence within 50 ms, without an exception.</param>
        /// <returns>The reports, for one <c>foreach</c>.</returns>
        /// <exception cref="EcmskException">None has come within <see cref="BoardOptions.ReadLimit"/>, or as for
        /// <see cref="Read"/>.</exception>
        public IEnumerable<Snapshot> Reports(CancellationToken cancel = default(CancellationToken))
        {
            long before = NewestSequence;
            while (!cancel.IsCancellationRequested)
            {
                Snapshot snapshot = Next("the next cycle", options.ReadLimit, cancel, before);
                if (snapshot == null)
                    yield break;
                before = snapshot.Sequence;
                yield return snapshot;
            }
        }

        /// <summary>As <see cref="Reports"/>, for <c>await foreach</c>: the waits are in threads of the pool.</summary>
        /// <param name="cancel">As for <see cref="Reports"/>.</param>
        /// <returns>The reports.</returns>
        public AwaitedReports ReportsAsync(CancellationToken cancel = default(CancellationToken))
        {
            return new AwaitedReports(this, cancel);
        }

        /// <summary>Writes a command frame, with its CRC, and waits for no effect.</summary>
        /// <param name="frame">The frame, which is not changed.</param>
        /// <exception cref="ArgumentNullException">There is no frame.</exception>
        /// <exception cref="ArgumentException">The frame has slots of another size than the board.</exception>
        /// <exception cref="EcmskException">It was not taken within <see cref="BoardOptions.WriteLimit"/>, or the board is lost
        /// or closed.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void Write(CommandFrame frame)
        {
            if (frame == null)
                throw new ArgumentNullException("frame");
            if (frame.SlotSize != SlotSize)
                throw new ArgumentException("the frame's slots have another size; make it with the board's SlotSize", "frame");
            CheckOpen();
            var bytes = (byte[])frame.Bytes.Clone();
            Frames.FillCrc(bytes, SlotSize);
            native.Check(native.Write(handle, bytes, (UIntPtr)bytes.Length, Milliseconds(options.WriteLimit)));
        }

        /// <summary>The statistics of the link since it was opened.</summary>
        /// <returns>A copy.</returns>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public LinkStats GetStats()
        {
            return new LinkStats(Counts(native.GetStats, LinkStats.Words), Interlocked.Read(ref badCrc));
        }

        /// <summary>The counters of the board since it booted.</summary>
        /// <returns>A copy.</returns>
        /// <exception cref="EcmskException">The link has none (<see cref="ErrorKind.Unsupported"/>): it is a real board.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public BoardCounters GetCounters()
        {
            return new BoardCounters(native, Counts(native.GetCounters, BoardCounters.Words));
        }

        ulong[] Counts(Native.CountFunction get, int count)
        {
            CheckOpen();
            var words = new ulong[count];
            words[0] = (ulong)count * 8;
            native.Check(get(handle, words));
            return words;
        }

        void CheckOpen()
        {
            if (handle.HasEnded)
                throw new ObjectDisposedException("Board", "the board was disposed of; open it again with Board.Open");
        }

        string NameOfLink()
        {
            UIntPtr needed;
            native.Check(native.GetLinkName(handle, null, UIntPtr.Zero, out needed));
            var buffer = new byte[(int)needed];
            native.Check(native.GetLinkName(handle, buffer, needed, out needed));
            return System.Text.Encoding.UTF8.GetString(buffer, 0, buffer.Length - 1);
        }

        SlotSize? SizeInLink()
        {
            foreach (string key in LinkName.Substring(LinkName.IndexOf('?') + 1).Split('&'))
                if (key == "slot=12" || key == "slot=16")
                    return key == "slot=12" ? SlotSize.Bytes12 : SlotSize.Bytes16;
            return null;
        }

        // The size with which the CRC of a report is right.
        SlotSize SizeByCrc()
        {
            var report = new byte[Frames.MaxLength];
            for (int i = 0; i < ProbeReports; i++)
            {
                native.Check(native.Read(handle, report, (UIntPtr)report.Length, Milliseconds(options.ReadLimit)));
                byte found = Frames.CrcFound(report);
                bool is12 = found == Frames.Crc(report, SlotSize.Bytes12);
                bool is16 = found == Frames.Crc(report, SlotSize.Bytes16);
                if (is12 != is16)
                    return is12 ? SlotSize.Bytes12 : SlotSize.Bytes16;
            }
            throw EcmskException.Of(
                ErrorKind.SlotUnknown,
                "`{0}` does not say how many bytes a slot has; put `slot=12` or `slot=16` (CONFIG2 high) into the link", LinkName);
        }

        static long Milliseconds(TimeSpan limit)
        {
            if (limit == Timeout.InfiniteTimeSpan)
                return Native.WaitForever;
            if (limit < TimeSpan.Zero)
                throw new ArgumentOutOfRangeException("limit", limit, "a limit is 0 or more, or Timeout.InfiniteTimeSpan");
            return (long)Math.Ceiling(limit.TotalMilliseconds);
        }
    }
}
