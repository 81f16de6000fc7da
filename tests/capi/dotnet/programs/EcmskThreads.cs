// The package Ecmsk: calls of several threads, and calls that end by exceptions. Its argument is the link of two drives and an IO
// slave with the script of the test: at 10 s input 0 of the IO slave comes on, the board executes nothing for 1 s and SDO transfers
// are slow; at 10.5 s slave 2 does not answer for 100 ms, which changes the state byte; at 20 s slave 1 has an alarm.
using System;
using System.Threading;
using Ecmsk;

static class EcmskThreads
{
    static string link;
    static int boards;

    static void That(bool holds, string what)
    {
        if (holds)
            return;
        Console.Error.WriteLine("not so: " + what);
        Environment.Exit(1);
    }

    // A board of its own in OP.
    static Board InOp(BoardOptions options = null)
    {
        Board board = Board.Open(link + "&name=threads" + ++boards, options);
        board.SetState(MasterState.PreOp);
        board.Configure(new[] { Slave.Drive(), Slave.Drive(), Slave.Io });
        board.SetState(MasterState.Op);
        return board;
    }

    // Reads up to the time of the script.
    static void UntilScript(Board board)
    {
        while (board.Read().Inputs(3) != 1)
        {
        }
    }

    // Runs a call in another thread; its exception, null without one.
    static Exception Beside(Action call, Action meanwhile = null)
    {
        Exception end = null;
        var thread = new Thread(() =>
        {
            try
            {
                call();
            }
            catch (Exception error)
            {
                end = error;
            }
        });
        thread.IsBackground = true;
        thread.Start();
        if (meanwhile != null)
            meanwhile();
        That(thread.Join(TimeSpan.FromMinutes(1)), "a call in another thread ends");
        return end;
    }

    static bool Is(ErrorKind kind, Exception error)
    {
        var known = error as EcmskException;
        return known != null && known.Kind == kind;
    }

    // Reads on for 2 s of the board's time: whether the axis was off at their end.
    static bool StaysOff(Board board, int axis)
    {
        for (int n = 0; n < 2000; n++)
            board.Read();
        return !board.Snapshot.Drive(axis).Value.IsEnabled;
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

    static int Main(string[] arguments)
    {
        link = arguments[0];
        AStreamThatSleeps();
        AStreamThatEnds();
        AStreamThatEndsBesideASwitchOn();
        ACallThatLasts();
        AHandlerThatThrows();
        OffDuringOn();
        AProgramThatWaits();
        AReaderBesideCalls();
        Console.WriteLine("ok");
        return 0;
    }

    // While a stream makes no step, calls of other threads send their commands themselves.
    static void AStreamThatSleeps()
    {
        using (Board board = InOp())
        {
            board.ServoOn(1, 2);
            int at = board.Snapshot.Position(1).Value;
            using (AxisStream stream = board.Stream(10))
            {
                stream.Csp(1, at + 5);
                stream.Step();
                Exception end = Beside(() =>
                {
                    board.ServoOff(2);
                    board.SetOutputs(3, 0x5A);
                    board.ServoOn(2);
                });
                That(end == null, "calls beside a stream that sleeps: " + end);
                That(board.Snapshot[3].Data1 == 0x5A && board.Snapshot.Drive(2).Value.IsEnabled, "their commands are executed");
                // Nothing of them is left for the next step.
                ulong written = board.GetStats().Written;
                board.Write(Off(board, 2));
                stream.Csp(1, at + 10);
                stream.Step();
                That(board.GetStats().Written == written + 2, "a frame of each");
                That(StaysOff(board, 2), "no command is left");
                end = Beside(() => board.SetState(MasterState.SafeOp));
                That(end == null, "a change of state beside a stream that sleeps: " + end);
            }
        }
    }

    static CommandFrame Off(Board board, int axis)
    {
        var frame = new CommandFrame(board.SlotSize);
        frame[axis] = new Slot { Id = 0x12 };
        return frame;
    }

    // A command that waits for the next step of a stream goes on its own way when there is none any more.
    static void AStreamThatEnds()
    {
        using (Board board = InOp())
        {
            AxisStream stream = board.Stream(10);
            stream.Step();
            Exception end = Beside(() => board.SetState(MasterState.SafeOp), () =>
            {
                Thread.Sleep(20);
                stream.Dispose();
            });
            That(end == null, "a change of state while a stream ends: " + end);
        }
    }

    // A switch-on beside a stream has failed. It is taken back although the stream ends.
    static void AStreamThatEndsBesideASwitchOn()
    {
        using (Board board = InOp(new BoardOptions { ServoLimit = TimeSpan.FromMilliseconds(700) }))
        {
            UntilScript(board);
            var waits = new ManualResetEvent(false);
            var stepped = new ManualResetEvent(false);
            board.StateChanged += (sender, change) =>
            {
                waits.Set();
                stepped.WaitOne();
            };
            Exception end;
            using (AxisStream stream = board.Stream(100))
                end = Beside(() => board.ServoOn(1), () =>
                {
                    waits.WaitOne();
                    stream.Step();
                    stepped.Set();
                });
            That(Is(ErrorKind.Timeout, end), "the board executes nothing: " + end);
            That(StaysOff(board, 1), "what did not come on in time does not come on by itself");
        }
    }

    // While a call of another thread lasts, axes are switched off.
    static void ACallThatLasts()
    {
        using (Board board = InOp())
        {
            board.ServoOn(1);
            UntilScript(board);
            Exception end = null;
            int changes = 0;
            board.StateChanged += (sender, change) =>
            {
                if (changes++ == 0)
                    end = Beside(() => board.ServoOff(1));
            };
            That(board.SdoRead<uint>(1, 0x1000) == 0x00020192, "a slow transfer");
            That(changes > 0 && end == null, "off during a transfer: " + end);
            That(!board.Snapshot.Drive(1).Value.IsEnabled, "the axis is off");
        }
    }

    // A handler of the program ends a switch-on. It is taken back.
    static void AHandlerThatThrows()
    {
        using (Board board = InOp())
        {
            UntilScript(board);
            bool throws = true;
            board.StateChanged += (sender, change) =>
            {
                if (!throws)
                    return;
                throws = false;
                throw new InvalidOperationException("of a handler");
            };
            Exception end = Ends(() => board.ServoOn(1));
            That(end is InvalidOperationException, "the exception of the handler: " + end);
            That(StaysOff(board, 1), "what was not waited for does not come on by itself");
        }
    }

    // A switch-on during which another thread switches off ends, and the axis stays off.
    static void OffDuringOn()
    {
        using (Board board = InOp())
        {
            UntilScript(board);
            Exception off = null;
            int changes = 0;
            board.StateChanged += (sender, change) =>
            {
                if (changes++ == 0)
                    off = Beside(() => board.ServoOff(1));
            };
            Exception on = Ends(() => board.ServoOn(1));
            That(changes > 0 && off == null, "off during a switch-on: " + off);
            That(Is(ErrorKind.NotEnabled, on), "the switch-on ends: " + on);
            That(StaysOff(board, 1), "the axis stays off");
            board.ServoOn(1);
        }
    }

    // After a pause of the program the first target is checked against the newest report.
    static void AProgramThatWaits()
    {
        using (Board board = InOp())
        {
            UntilScript(board);
            for (int n = 0; n < 9000; n++)
                board.Read();
            board.ServoOn(1);
            using (AxisStream stream = board.Stream(10))
            {
                int at = stream.Snapshot.Position(1).Value;
                stream.Csp(1, at);
                stream.Step();
                // Writing takes time, too.
                for (int n = 0; n < 16000; n++)
                    board.Write(new CommandFrame(board.SlotSize));
                That(Ends(() => stream.Csp(1, at)) is AlarmException, "the alarm is seen");
            }
        }
    }

    // What a report of one cycle alone shows is missed by no call, whoever reads it.
    static void AReaderBesideCalls()
    {
        using (Board board = InOp())
        {
            bool isDone = false;
            Exception end = null;
            var reader = new Thread(() =>
            {
                long last = 0;
                while (!Volatile.Read(ref isDone))
                {
                    long now = board.Read().Sequence;
                    That(now > last, "reports come in their order");
                    last = now;
                }
            });
            reader.Start();
            var caller = new Thread(() =>
            {
                end = Ends(() =>
                {
                    for (ushort n = 1; n <= 30; n++)
                        board.SetOutputs(3, n);
                });
                Volatile.Write(ref isDone, true);
            });
            caller.Start();
            using (AxisStream stream = board.Stream(10))
            {
                while (!Volatile.Read(ref isDone))
                    stream.Step();
                That(stream.Losses == 0, "the stream keeps to its depth");
            }
            caller.Join();
            reader.Join();
            That(end == null, "outputs beside a stream and a reader: " + end);
        }
    }
}
