// How the commands of calls get into frames. A thread that steps a stream writes a frame in each cycle, and the commands of other
// threads ride in those: a frame of their own would be a gap in the motion. If it makes no step, nobody waits for it.

using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Threading;

namespace Ecmsk
{
    public sealed partial class Board
    {
        // [OURS] Without a step of the stream for this time and one cycle, calls write frames of their own. As in the native API.
        static readonly TimeSpan StreamPause = TimeSpan.FromMilliseconds(50);

        // Commands, by slot, for which a call waits until a frame with them was written.
        sealed class Post
        {
            public IDictionary<int, Slot> Commands;
            public bool IsWritten;
            // The number of the newest report when it was written.
            public long SentAt;
        }

        // The commands that wait, in the order of their calls. Locked while frames of calls and of the stream are written, so that
        // they have one order, and for `stream`, `offs` and `offsUnderWay`.
        readonly List<Post> posts = new List<Post>();
        AxisStream stream;
        // For each axis: how often it was to be switched off, and in how many calls that is under way.
        readonly Dictionary<int, int> offs = new Dictionary<int, int>();
        readonly Dictionary<int, int> offsUnderWay = new Dictionary<int, int>();

        // Returns as soon as a frame with these commands was written: the number of the newest report then. If that fails, they are
        // in no later one. `mayBeSent` is called before each frame and ends the call by an exception.
        long Send(IDictionary<int, Slot> commands, Action mayBeSent = null)
        {
            var post = new Post { Commands = commands };
            lock (posts)
            {
                posts.Add(post);
                try
                {
                    while (!post.IsWritten)
                    {
                        if (mayBeSent != null)
                            mayBeSent();
                        TimeSpan left = stream == null ? TimeSpan.Zero : stream.TakesPostsFor(StreamPause + Cycle);
                        if (left > TimeSpan.Zero)
                            Monitor.Wait(posts, left);
                        else
                            WriteWithPosts(new CommandFrame(SlotSize));
                    }
                }
                finally
                {
                    posts.Remove(post);
                }
            }
            return post.SentAt;
        }

        // Writes a frame with the commands that wait, in the place of what it has in their slots. A slot has room for one command:
        // those of a later call are left for the next frame. The frame itself is not changed.
        void WriteWithPosts(CommandFrame frame)
        {
            lock (posts)
            {
                var full = new CommandFrame(frame);
                var used = new HashSet<int>();
                var taken = new List<Post>();
                foreach (Post post in posts)
                {
                    bool hasRoom = !post.Commands.Keys.Any(used.Contains);
                    used.UnionWith(post.Commands.Keys);
                    if (!hasRoom)
                        continue;
                    foreach (KeyValuePair<int, Slot> command in post.Commands)
                        full[command.Key] = command.Value;
                    taken.Add(post);
                }
                long before = NewestSequence;
                Write(full);
                foreach (Post post in taken)
                {
                    post.IsWritten = true;
                    post.SentAt = before;
                    posts.Remove(post);
                }
                if (taken.Count > 0)
                    Monitor.PulseAll(posts);
            }
        }

        // Writes a frame of the stream, and notes when.
        internal void WriteStep(CommandFrame frame, ref long steppedAt)
        {
            lock (posts)
            {
                WriteWithPosts(frame);
                steppedAt = Stopwatch.GetTimestamp();
            }
        }

        // Calls that wait for a frame of the stream look whether there will be one.
        internal void WakePosts()
        {
            lock (posts)
                Monitor.PulseAll(posts);
        }

        internal void EndStream()
        {
            lock (posts)
            {
                stream = null;
                Monitor.PulseAll(posts);
            }
        }

        TimeSpan Cycle
        {
            get { return TimeSpan.FromMilliseconds(cycleUs / 1000.0); }
        }

        // How often each of these axes was to be switched off up to now.
        int[] Offs(IEnumerable<int> axes)
        {
            lock (posts)
                return axes.Select(axis => Count(offs, axis)).ToArray();
        }

        // Refuses to switch axes on if one of them was to be switched off since `before`.
        void RefuseSwitchedOff(int[] axes, int[] before)
        {
            int[] now = Offs(axes);
            for (int i = 0; i < axes.Length; i++)
                if (now[i] != before[i])
                    throw EcmskException.Of(
                        ErrorKind.NotEnabled, "switching on: another thread has called ServoOff for slave {0}; call ServoOn again after that",
                        axes[i]);
        }

        // Waits until no call is switching one of these axes off.
        void AwaitOffs(int[] axes)
        {
            var clock = Stopwatch.StartNew();
            lock (posts)
                while (axes.Any(axis => Count(offsUnderWay, axis) > 0))
                {
                    if (options.ServoLimit >= TimeSpan.Zero && clock.Elapsed > options.ServoLimit)
                        throw EcmskException.Of(
                            ErrorKind.Timeout, "switching on: ServoOff in another thread still waits for slave {0}; {1}",
                            axes.First(axis => Count(offsUnderWay, axis) > 0), DriveHint);
                    Monitor.Wait(posts, StreamPause);
                }
        }

        // Runs a call that switches these axes off. It ends each ServoOn of one of them that has begun before, and the commands of
        // that are not sent any more.
        void CountOffs(int[] axes, Action switchOff)
        {
            lock (posts)
            {
                foreach (int axis in axes)
                {
                    offs[axis] = Count(offs, axis) + 1;
                    offsUnderWay[axis] = Count(offsUnderWay, axis) + 1;
                }
                posts.RemoveAll(post => axes.Any(axis =>
                    post.Commands.ContainsKey(axis) && post.Commands[axis].Id == (byte)Command.ServoOn));
                Monitor.PulseAll(posts);
            }
            try
            {
                switchOff();
            }
            finally
            {
                lock (posts)
                {
                    foreach (int axis in axes)
                        offsUnderWay[axis]--;
                    Monitor.PulseAll(posts);
                }
            }
        }

        static int Count(Dictionary<int, int> counts, int axis)
        {
            int count;
            counts.TryGetValue(axis, out count);
            return count;
        }
    }
}
