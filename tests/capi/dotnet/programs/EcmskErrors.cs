// The package Ecmsk: what goes wrong. Its argument is the link. It prints the messages that a test compares.
using System;
using System.Threading;
using Ecmsk;

static class EcmskErrors
{
    static void That(bool holds, string what)
    {
        if (holds)
            return;
        Console.Error.WriteLine("not so: " + what);
        Environment.Exit(1);
    }

    // Runs a call that must fail; prints its kind and message.
    static T Fails<T>(Action call) where T : Exception
    {
        try
        {
            call();
        }
        catch (T error)
        {
            // The runtime's own exceptions have other words in each runtime.
            var known = error as EcmskException;
            Console.WriteLine(known == null ? error.GetType().Name : known.Kind + ": " + error.Message);
            return error;
        }
        That(false, "it fails with " + typeof(T).Name);
        return null;
    }

    static void Is(ErrorKind kind, Action call)
    {
        That(Fails<EcmskException>(call).Kind == kind, kind.ToString());
    }

    static int Main(string[] arguments)
    {
        string link = arguments[0];
        if (arguments.Length > 1)
            return Waits(link);
        Fails<ArgumentNullException>(() => Board.Open(null));
        Fails<ArgumentException>(() => Board.Open("sim:\0"));
        Is(ErrorKind.Argument, () => Board.Open("simm:"));
        Is(ErrorKind.Argument, () => Board.Open("sim:?slaves=lathe"));
        Is(ErrorKind.Argument, () => Board.Open(""));

        Board board = Board.Open(link + "&name=errors", new BoardOptions { SdoLimit = TimeSpan.FromMilliseconds(200) });
        Is(ErrorKind.InUse, () => Board.Open(link + "&name=errors"));
        board.SetState(MasterState.PreOp);
        Is(ErrorKind.WrongState, () => board.ServoOn(1));
        Is(ErrorKind.SlaveCount, () => board.Configure(new[] { Slave.Drive() }));
        Is(ErrorKind.Config, () => board.Configure(new Slave[0]));
        Is(ErrorKind.Config, () => board.Configure(new[] { Slave.Drive(), null }));
        Is(ErrorKind.Config, () => board.Configure(new[] { Slave.Drive(), Slave.Drive() }, 300));
        board.Configure(new[] { Slave.Io, Slave.Drive() });
        Is(ErrorKind.StateStuck, () => board.SetState(MasterState.Op));
        board.SetState(MasterState.PreOp);
        board.Configure(new[] { Slave.Drive(), Slave.Drive() });
        board.SetState(MasterState.Op);

        var aborted = Fails<SdoAbortedException>(() => board.SdoRead<uint>(1, 0x5555, 2));
        That(aborted.Code == 0x06020000 && aborted.Object.Equals(new SdoObject(0x5555, 2)) && aborted.Slave == 1, "what was aborted");
        Fails<SdoAbortedException>(() => board.SdoWrite<uint>(1, 0x1000, 0, 1));
        Is(ErrorKind.SdoTooWide, () => board.SdoRead<byte>(1, 0x1000));
        Is(ErrorKind.NoSuchSlave, () => board.SdoRead<byte>(41, 0x1000));
        Fails<ArgumentException>(() => board.SdoRead<long>(1, 0x1000));
        Is(ErrorKind.NoSuchSlave, () => board.ServoOn(3));
        Is(ErrorKind.WrongKind, () => board.Inputs(1));
        Fails<ArgumentNullException>(() => board.Write(null));
        Fails<ArgumentException>(() => board.Write(new CommandFrame(
            board.SlotSize == SlotSize.Bytes12 ? SlotSize.Bytes16 : SlotSize.Bytes12)));
        Fails<ArgumentOutOfRangeException>(() => new CommandFrame(board.SlotSize).Csp(41, 0));
        Is(ErrorKind.Setting, () => board.Stream(0));
        using (AxisStream stream = board.Stream(10))
        {
            Is(ErrorKind.Busy, () => board.Stream(10));
            Is(ErrorKind.NotEnabled, () => stream.Csp(1, 0));
            board.ServoOn(1);
            Is(ErrorKind.TooFar, () => stream.Csp(1, 1000000000));
        }
        Is(ErrorKind.Timeout, () => board.Read(TimeSpan.Zero));
        using (var soon = new CancellationTokenSource())
        {
            soon.Cancel();
            Fails<OperationCanceledException>(() => board.Read(null, soon.Token));
            foreach (Snapshot report in board.Reports(soon.Token))
                That(false, "a cancelled sequence has no report");
        }

        // Two threads: one reads, one transfers; then the board is disposed of under both.
        long read = 0;
        Exception end = null;
        var reader = new Thread(() =>
        {
            try
            {
                foreach (Snapshot report in board.Reports())
                    Interlocked.Increment(ref read);
            }
            catch (Exception error)
            {
                end = error;
            }
        });
        reader.IsBackground = true;
        reader.Start();
        for (int n = 0; n < 20; n++)
            That(board.SdoRead<uint>(1 + n % 2, 0x1000) != 0, "an SDO beside a reader");
        while (Interlocked.Read(ref read) == 0)
            Thread.Yield();
        board.Dispose();
        reader.Join();
        var closed = end as EcmskException;
        That(end is ObjectDisposedException || closed != null && closed.Kind == ErrorKind.Closed, "by the disposal: " + end);

        board.Dispose();
        That(board.IsClosed, "it is closed");
        Fails<ObjectDisposedException>(() => board.Read());
        Fails<ObjectDisposedException>(() => board.Write(new CommandFrame(board.SlotSize)));
        Fails<ObjectDisposedException>(() => board.GetStats());
        Fails<ObjectDisposedException>(() => board.SetState(MasterState.Op));
        That(board.Snapshot != null, "the newest report stays");

        // The board is free again. One that is forgotten is closed by the garbage collector.
        Forget(link);
        GC.Collect();
        GC.WaitForPendingFinalizers();
        using (Board again = Board.Open(link + "&name=errors"))
            That(again.Read().Sequence > 0, "it is open again");

        // Reports with wrong CRCs are discarded.
        using (Board lies = Board.Open(link + "&fault.corrupt.read=0.5&fault.seed=1"))
        {
            for (int n = 0; n < 50; n++)
                lies.Read();
            That(lies.GetStats().BadCrc > 5 && lies.GetStats().ReadFaults.Corrupted > 5, "reports are discarded");
        }
        // They count as a cycle each for the limit of a read, however long that is.
        var twelve = new BoardOptions { SlotSize = SlotSize.Bytes12 };
        using (Board noisy = Board.Open(link + "&fault.corrupt.read=0.9&fault.seed=1", twelve))
        {
            noisy.Adopt(new[] { Slave.Drive(), Slave.Drive() }, 4000);
            long bad = 0;
            Exception late = null;
            while (late == null)
            {
                bad = noisy.GetStats().BadCrc;
                late = Ends(() => noisy.Read(TimeSpan.FromMilliseconds(20)));
            }
            That(noisy.GetStats().BadCrc == bad + 5, "20 ms are 5 cycles of 4 ms");
        }

        // The network leaves OP while a call waits.
        using (Board leaves = Board.Open(link + "&name=leaves"))
        {
            leaves.SetState(MasterState.PreOp);
            leaves.Configure(new[] { Slave.Drive(), Slave.Drive() });
            leaves.SetState(MasterState.Op);
            var down = new CommandFrame(leaves.SlotSize);
            down[0] = new Slot { Id = 0x01, Data1 = 0x02 };
            leaves.Write(down);
            var wrong = Ends(() => leaves.ServoOn(1)) as EcmskException;
            That(wrong != null && wrong.Kind == ErrorKind.WrongState, "at once: " + wrong);
        }
        Console.WriteLine("ok");
        return 0;
    }

    static Exception Ends(Action call)
    {
        try
        {
            call();
            return null;
        }
        catch (Exception error)
        {
            return error;
        }
    }

    // A read that waits is ended by the disposal of the board, whatever it does at that moment.
    static int Waits(string link)
    {
        for (int n = 0; n < 10; n++)
        {
            Board board = Board.Open(link, new BoardOptions { ReadLimit = TimeSpan.FromMinutes(1) });
            Exception end = null;
            var began = new ManualResetEvent(false);
            var reader = new Thread(() =>
            {
                try
                {
                    for (;;)
                    {
                        board.Read(Timeout.InfiniteTimeSpan);
                        began.Set();
                    }
                }
                catch (Exception error)
                {
                    end = error;
                }
            });
            reader.Start();
            began.WaitOne();
            board.Dispose();
            reader.Join();
            var closed = end as EcmskException;
            That(end is ObjectDisposedException || closed != null && closed.Kind == ErrorKind.Closed, "by the disposal: " + end);
        }
        Console.WriteLine("ok");
        return 0;
    }

    [System.Runtime.CompilerServices.MethodImpl(System.Runtime.CompilerServices.MethodImplOptions.NoInlining)]
    static void Forget(string link)
    {
        var thread = new Thread(() => Board.Open(link + "&name=errors").Read());
        thread.Start();
        thread.Join();
    }
}
