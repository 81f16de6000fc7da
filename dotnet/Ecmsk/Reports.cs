// Reports: one thread at a time reads them, and all calls that wait get them, each one in turn. What a command shows in the report
// of one cycle alone is missed by no call, whoever reads it.

using System;
using System.Diagnostics;
using System.Threading;

namespace Ecmsk
{
    public sealed partial class Board
    {
        // [OURS] How long a read that can be cancelled waits before it looks whether it was.
        const long SliceMs = 50;
        // [OURS] Reports that are kept for calls that are late. More than the link keeps.
        const int RecentReports = 64;
        // [OURS] If another thread's read does not end within this time, nothing is left to read.
        const int DrainWaitMs = 2;

        // The lock of the fields below. It is pulsed when a read has ended.
        readonly object news = new object();
        // The report with the number n is at n % RecentReports.
        readonly Snapshot[] recent = new Snapshot[RecentReports];
        Snapshot newest;
        bool isReading;
        long badCrc;

        /// <summary>The newest report that was read. Nothing is read for it.</summary>
        public Snapshot Snapshot
        {
            get
            {
                lock (news)
                    return newest;
            }
        }

        // The number of the newest report; 0 before the first one.
        long NewestSequence
        {
            get
            {
                Snapshot now = Snapshot;
                return now == null ? 0 : now.Sequence;
            }
        }

        // Decodes the newest report with another configuration.
        void DecodeNewest(Slave[] network)
        {
            lock (news)
                Keep(new Snapshot(newest, network));
        }

        void Keep(Snapshot snapshot)
        {
            newest = snapshot;
            recent[snapshot.Sequence % RecentReports] = snapshot;
        }

        // The first kept report behind the one with that number; null if there is none. The caller holds `news`.
        Snapshot Behind(long before)
        {
            if (newest == null || newest.Sequence <= before)
                return null;
            return recent[Math.Max(before + 1, newest.Sequence - RecentReports + 1) % RecentReports];
        }

        // The first report behind the one with that number; null if the wait was cancelled.
        Snapshot Next(string what, TimeSpan limit, CancellationToken cancel, long before)
        {
            CheckOpen();
            double left = Milliseconds(limit);
            bool isEndless = left == Native.WaitForever;
            for (;;)
            {
                if (cancel.IsCancellationRequested)
                    return null;
                long slice = cancel.CanBeCanceled && (isEndless || left > SliceMs) ? SliceMs : (long)Math.Ceiling(left);
                Snapshot snapshot;
                double waited;
                int result = ReadOnce(slice, before, out snapshot, out waited);
                if (snapshot != null)
                    return snapshot;
                if (result < 0 && result != (int)ErrorKind.Timeout)
                    throw native.Error(result);
                left -= waited;
                if (!isEndless && left <= 0)
                    throw EcmskException.Of(
                        ErrorKind.Timeout,
                        "{0}: no usable report for {1} ms ({2} with a wrong CRC since it was opened); "
                        + "check the cable to the first slave and the board's power",
                        what, Milliseconds(limit), Interlocked.Read(ref badCrc));
            }
        }

        // The library's result; a report behind the one with that number, if there is one; and how long it has waited, in
        // milliseconds. A report with a wrong CRC is none.
        int ReadOnce(long timeoutMs, long before, out Snapshot snapshot, out double waited)
        {
            waited = timeoutMs;
            lock (news)
            {
                snapshot = Behind(before);
                if (snapshot != null)
                    return 0;
                if (isReading)
                {
                    var clock = Stopwatch.StartNew();
                    bool isEnded = timeoutMs != 0 && Monitor.Wait(news, (int)Math.Min((ulong)timeoutMs, int.MaxValue));
                    snapshot = Behind(before);
                    if (isEnded)
                        waited = clock.Elapsed.TotalMilliseconds;
                    return (int)ErrorKind.Timeout;
                }
                isReading = true;
            }
            Snapshot last = null;
            int result;
            try
            {
                var report = new byte[Frames.MaxLength];
                result = native.Read(handle, report, (UIntPtr)report.Length, timeoutMs);
                // Byte 3 is 0 if the board fills in no CRC.
                byte crc = Frames.CrcFound(report);
                bool isWrong = result >= 0 && crc != 0 && crc != Frames.Crc(report, SlotSize);
                if (isWrong)
                {
                    Interlocked.Increment(ref badCrc);
                    // It has taken about a cycle.
                    waited = Cycle.TotalMilliseconds;
                }
                else if (result >= 0)
                    lock (news)
                    {
                        last = newest;
                        snapshot = new Snapshot(report, SlotSize, slaves, last == null ? 1 : last.Sequence + 1);
                        Keep(snapshot);
                    }
            }
            finally
            {
                lock (news)
                {
                    isReading = false;
                    Monitor.PulseAll(news);
                }
            }
            EventHandler<StateChangedEventArgs> changed = StateChanged;
            if (changed != null && last != null && !last.State.Equals(snapshot.State))
                changed(this, new StateChangedEventArgs(last.State, snapshot));
            return result;
        }

        // Reads what the link has kept, so that the next report is a new one. `mayWait`: another thread that reads some of it is
        // waited for.
        void Drain(bool mayWait = true)
        {
            CheckOpen();
            for (int i = 0; i < RecentReports; i++)
            {
                lock (news)
                    if (isReading && (!mayWait || !Monitor.Wait(news, DrainWaitMs)))
                        return;
                Snapshot snapshot;
                double waited;
                if (ReadOnce(0, long.MaxValue, out snapshot, out waited) < 0)
                    return;
            }
        }
    }
}
