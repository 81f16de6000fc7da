// The package Ecmsk: to OP, axes on, a move, SDOs, inputs and outputs, counters, to the end. Its argument is the link.
using System;
using System.Linq;
using System.Threading;
using System.Threading.Tasks;
using Ecmsk;

static class EcmskMoves
{
    static void That(bool holds, string what)
    {
        if (holds)
            return;
        Console.Error.WriteLine("not so: " + what);
        Environment.Exit(1);
    }

    static int Main(string[] arguments)
    {
        string states = "";
        using (Board board = Board.Open(arguments[0]))
        {
            board.StateChanged += (sender, change) =>
            {
                That(sender == board && !change.Before.Equals(change.Snapshot.State), "a change is one");
                states += change.Before + " > " + change.Snapshot.State + "; ";
            };
            That(board.LinkName.StartsWith("sim:", StringComparison.Ordinal), board.LinkName);
            Console.WriteLine("slots of {0}, in {1}", (int)board.SlotSize, board.Snapshot.State);

            board.SetState(MasterState.PreOp);
            board.Configure(new[] { Slave.Drive(), Slave.Drive(), Slave.Io });
            board.SdoWrite<sbyte>(1, 0x6098, 0, -3);
            That(board.SdoRead<sbyte>(1, 0x6098) == -3, "what was written is read");
            // The same request twice: each has an answer of its own.
            board.SdoWrite<sbyte>(1, 0x6098, 0, 33);
            That(board.SdoRead<sbyte>(1, 0x6098) == 33, "the second value is read");
            Console.WriteLine("device type 0x{0:X8}", board.SdoRead<uint>(1, 0x1000));

            board.SetState(MasterState.Op);
            board.ServoOn(1, 2);
            That(board.Snapshot.Drive(1).Value.IsEnabled && board.Snapshot.Drive(3) == null, "drives are on, an IO slave is none");

            int start = board.Snapshot.Position(1).Value, at = 0;
            using (AxisStream stream = board.Stream(20))
            {
                for (int n = 1; n <= 1000; n++)
                {
                    stream.Csp(1, start + 10 * n);
                    stream.Csp(2, -10 * n);
                    stream.Step();
                    at = Math.Max(at, stream.Snapshot.Position(1).Value);
                }
                stream.Finish();
                Console.WriteLine("{0} frames, {1} lost", stream.Frames, stream.Losses);
            }
            That(at > start + 9000, "positions come while it moves");
            Snapshot there = null;
            for (int n = 0; n < 500; n++)
                there = board.Read();
            Console.WriteLine("moved {0} and {1}", there.Position(1) - start, there.Position(2));

            // Commands of another thread ride in the frames of a stream.
            using (AxisStream stream = board.Stream(10))
            {
                uint type = 0;
                var thread = new Thread(() => type = board.SdoRead<uint>(2, 0x1000));
                thread.Start();
                for (int n = 0; thread.IsAlive; n++)
                {
                    stream.Csp(1, start + 10000);
                    stream.Step();
                    That(n < 1000000, "the transfer ends");
                }
                thread.Join();
                That(type == board.SdoRead<uint>(1, 0x1000), "the device type of another thread");
            }

            board.SetOutputs(3, 0x5A5A);
            That(board.Inputs(3) == board.Inputs(3), "inputs are read");
            var raw = new CommandFrame(board.SlotSize);
            raw.Outputs(3, 1);
            raw[2] = new Slot { Id = 0x12 };
            board.Write(raw);
            var limit = new CancellationTokenSource();
            Snapshot off = null;
            foreach (Snapshot report in board.Reports(limit.Token))
                if (!report.Drive(2).Value.IsEnabled)
                {
                    off = report;
                    limit.Cancel();
                }
            That(off != null && off.Drive(1).Value.IsEnabled, "a frame of its own has switched axis 2 off");
            Snapshot later = board.ReadAsync().Result;
            That(later.Sequence > off.Sequence && later.ToArray().Length == (board.SlotSize == SlotSize.Bytes12 ? 504 : 512), "a task");

            That(Awaited(board, later.Sequence).Result == 5, "five reports are awaited");

            BoardCounters counters = board.GetCounters();
            That(counters.Executed > 1000 && counters.Full == 0 && counters.Crc == 0, "the board has executed the frames");
            That(counters.Rejected.Count > 3 && counters.Rejected.Values.All(count => count == 0), "and rejected none");
            LinkStats stats = board.GetStats();
            That(stats.Written >= counters.Executed && stats.Read > 1000 && stats.BadCrc == 0, "the link has carried them");
            board.ServoOff(1, 2);
            board.SetState(MasterState.PreOp);
        }
        Console.WriteLine(states);
        Console.WriteLine("NEXTWUSBLib {0}", Board.LibraryVersion);
        return 0;
    }

    // What a compiler of C# 8 makes of `await foreach` over ReportsAsync, which is cancelled at the fifth report.
    static async Task<int> Awaited(Board board, long before)
    {
        int count = 0;
        using (var limit = new CancellationTokenSource())
        {
            var reports = board.ReportsAsync(limit.Token).GetAsyncEnumerator();
            try
            {
                while (await reports.MoveNextAsync())
                {
                    Snapshot report = reports.Current;
                    That(report.Sequence > before, "each is newer than the one before");
                    before = report.Sequence;
                    if (++count == 5)
                        limit.Cancel();
                }
            }
            finally
            {
                await reports.DisposeAsync();
            }
        }
        return count;
    }
}
