// Targets for axes in CSP, a frame for each cycle.

using System;
using System.Diagnostics;
using System.Threading;

namespace Ecmsk
{
    /// <summary>
    /// A stream of target positions: set targets, then call <see cref="Step"/>, which sends them in one frame and waits at the pace
    /// of the board. Its calls are for one thread.
    /// </summary>
    /// <remarks>
    /// It ends as <see cref="Finish"/> does: axes in CSP hold their last target, which they reach with the speed that they have.
    /// A program that is to stop gently lowers the speed itself.
    /// </remarks>
    public sealed class AxisStream : IDisposable
    {
        // [OURS] Room for reports that are on their way.
        internal const int MaxDepth = 140;
        // [OURS] More reports than a full FIFO takes.
        const int FinishReports = 1000;

        readonly Board board;
        readonly int depth;
        readonly CommandFrame frame;
        readonly int fullBefore;
        volatile int thread = Thread.CurrentThread.ManagedThreadId;
        volatile bool isDone;
        // Whether no target was set since the last step, so that the program may have waited since.
        bool hasStepped;
        // The number of the report that Step has looked at last, and how many frames were written since.
        long seen;
        int unseen;
        // When the last frame was written, by the Stopwatch. Under the lock of the board's posts.
        long steppedAt = Stopwatch.GetTimestamp();

        internal AxisStream(Board board, int depth)
        {
            this.board = board;
            this.depth = depth;
            frame = new CommandFrame(board.SlotSize);
            fullBefore = board.Snapshot.FullCount;
        }

        // For how much longer a call in this thread waits for a frame of this stream, if it makes no step for `pause`.
        internal TimeSpan TakesPostsFor(TimeSpan pause)
        {
            if (isDone || thread == Thread.CurrentThread.ManagedThreadId)
                return TimeSpan.Zero;
            double ticks = Stopwatch.GetTimestamp() - steppedAt;
            return pause - TimeSpan.FromSeconds(ticks / Stopwatch.Frequency);
        }

        /// <summary>The newest report.</summary>
        public Snapshot Snapshot
        {
            get { return board.Snapshot; }
        }

        /// <summary>Frames sent so far.</summary>
        public long Frames { get; private set; }

        /// <summary>Frames that the board has lost because its FIFO was full.</summary>
        public int Losses
        {
            get { return board.Snapshot.FullCount - fullBefore & 0xFFFF; }
        }

        /// <summary>Sets the next target position of an axis in CSP.</summary>
        /// <param name="slave">The number of the slave, from 1.</param>
        /// <param name="target">The absolute target, counts.</param>
        /// <exception cref="AlarmException">The axis has an alarm.</exception>
        /// <exception cref="EcmskException">
        /// The target is further from the actual position than the guard allows, or the axis is not in CSP or not on.
        /// </exception>
        /// <exception cref="ObjectDisposedException">The stream has ended.</exception>
        public void Csp(int slave, int target)
        {
            CheckOpen();
            Slave axis = board.Axis(slave, "a stream");
            if (axis.Mode != Mode.Csp)
                throw EcmskException.Of(
                    ErrorKind.WrongKind, "slave {0} runs in {1}, not in Csp; change its mode in the configuration", slave, axis.Mode);
            if (hasStepped)
            {
                board.DrainForStream();
                hasStepped = false;
            }
            Snapshot now = board.Snapshot;
            if (now.HasFault(slave))
                throw now.Alarm(slave);
            if (!now.IsEnabled(slave))
                throw EcmskException.Of(
                    ErrorKind.NotEnabled, "slave {0} is not in Operation enabled (statusword 0x{1:X4}); call ServoOn first",
                    slave, now.Statusword(slave));
            int actual = now.Position(slave) ?? 0;
            // Counts wrap at 32 bits.
            int distance = unchecked(target - actual);
            uint far = distance == int.MinValue ? 1u << 31 : (uint)Math.Abs(distance);
            if (axis.Guard != null && far > axis.Guard)
                throw EcmskException.Of(
                    ErrorKind.TooFar,
                    "target {0} of slave {1} is {2} counts from its position {3}, allowed are {4}; "
                    + "start from the actual position, or widen the axis's guard",
                    target, slave, far, actual, axis.Guard);
            frame.Csp(slave, target);
        }

        /// <summary>
        /// Sends the targets that were set since the last step, and waits until fewer than the stream's depth of frames wait in the
        /// board's FIFO.
        /// </summary>
        /// <exception cref="EcmskException">The network has left OP, or the board is lost or closed.</exception>
        /// <exception cref="ObjectDisposedException">The stream has ended.</exception>
        public void Step()
        {
            CheckOpen();
            thread = Thread.CurrentThread.ManagedThreadId;
            board.WriteStep(frame, ref steppedAt);
            frame.Clear();
            hasStepped = true;
            Frames++;
            board.DrainForStream();
            unseen++;
            for (bool hasWaited = false;; hasWaited = true)
            {
                Snapshot now = board.Snapshot;
                Board.RequireOp("a stream", now);
                if (now.Sequence != seen)
                {
                    // Without a wait the report may be older than the frame.
                    seen = now.Sequence;
                    unseen = hasWaited ? 0 : 1;
                }
                if (Ecmsk.Frames.FifoEntries - now.FifoFree + unseen <= depth)
                    return;
                board.NextInStream(now.Sequence);
            }
        }

        /// <summary>Waits until the board has executed all frames, and ends the stream. It may be called again.</summary>
        /// <exception cref="EcmskException">The network has left OP, or the board is lost or closed.</exception>
        public void Finish()
        {
            if (isDone)
                return;
            isDone = true;
            board.WakePosts();
            try
            {
                board.DrainForStream();
                Snapshot now = board.Snapshot;
                for (int i = 0; i < FinishReports; i++)
                {
                    now = board.NextInStream(now.Sequence);
                    Board.RequireOp("the end of a stream", now);
                    if (now.FifoFree == Ecmsk.Frames.FifoEntries)
                        return;
                }
                throw new EcmskException(
                    ErrorKind.Timeout, "the end of a stream: the board's FIFO does not run empty; see whether another program writes to it");
            }
            finally
            {
                board.EndStream();
            }
        }

        /// <summary>As <see cref="Finish"/>, without exceptions: the axes stop in any case when no frame comes any more.</summary>
        public void Dispose()
        {
            try
            {
                Finish();
            }
            catch (EcmskException)
            {
            }
            catch (ObjectDisposedException)
            {
            }
        }

        void CheckOpen()
        {
            if (isDone)
                throw new ObjectDisposedException("AxisStream", "the stream has ended; begin another one with Board.Stream");
        }
    }
}
