// Calls that send commands and wait until reports show their effect, one call at a time.

using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using System.Threading;

namespace Ecmsk
{
    public sealed partial class Board
    {
        // [OURS] A command that shows no effect is sent again after this many reports: more than a full FIFO takes.
        const int ResendReports = 200;
        // [OURS] How long the board may take to answer SET_AXIS, SET_DC and DRIVE_MODE.
        static readonly TimeSpan ConfigureLimit = TimeSpan.FromSeconds(2);
        const string LostHint = "see whether frames get lost (GetStats), then try again";
        const string DriveHint = "look at the drive's display; mains power, enable inputs and alarms keep a drive off";

        // [OURS] Reports from a command's execution until a drive shows what it does.
        const int ServoReports = 3;
        // [OURS] How long axes may take to go off after they did not come on.
        static readonly TimeSpan OffLimit = TimeSpan.FromSeconds(1);

        // Held by the call that is under way. What switches axes off does without.
        readonly object calls = new object();
        // An SDO transfer was not answered: its answer may still come.
        bool isSdoLate;

        /// <summary>Sends the configuration of the network, in PreOP: kinds of slaves, cycle and modes.</summary>
        /// <param name="network">The slaves in network order.</param>
        /// <param name="cycle">The cycle in microseconds: 250 * 2^n, at most 512000.</param>
        /// <exception cref="EcmskException">
        /// The configuration is not valid, the network is not in PreOP, or the board has found another number of slaves.
        /// </exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void Configure(IEnumerable<Slave> network, int cycle = 1000)
        {
            Slave[] list = Checked(network, cycle);
            lock (calls)
            {
                Drain();
                StateByte found = Snapshot.State;
                if (found.State != MasterState.PreOp)
                    throw WrongState("Configure", "PreOP", found);
                uint count = 0;
                for (int group = 0; group * 8 < Frames.MaxSlaves(SlotSize); group++)
                {
                    uint kinds = 0;
                    for (int k = 7; k >= 0; k--)
                    {
                        int at = group * 8 + k;
                        kinds = kinds << 4 | (uint)(at < list.Length ? list[at].Kind : SlaveKind.Unused);
                    }
                    count = AskBoard("SET_AXIS", Command.SetAxis, (ushort)group, kinds, 0);
                }
                if (count != list.Length)
                    throw EcmskException.Of(
                        ErrorKind.SlaveCount,
                        "{0} slaves are configured and the board found {1}; correct the list, or check cables and power",
                        list.Length, count);
                // 0xFFFF: the board chooses the shift of SYNC0.
                AskBoard("SET_DC", Command.SetDc, 0, (uint)cycle, 0xFFFF);
                var modes = new Dictionary<int, Slot>();
                for (int slave = 1; slave <= list.Length; slave++)
                    if (list[slave - 1].HasAxis)
                        modes[slave] = Of(Command.DriveMode, (uint)list[slave - 1].Mode, (uint)list[slave - 1].Sync);
                if (modes.Count > 0)
                    Run("DRIVE_MODE", LostHint, ConfigureLimit, modes, true, InState,
                        report => modes.Keys.All(slave => report[slave].Id == (byte)Command.DriveMode));
                SetNetwork(list, cycle);
            }
        }

        /// <summary>Takes over a board that is configured already, for example one in OP. Nothing is sent.</summary>
        /// <param name="network">Its slaves in network order.</param>
        /// <param name="cycle">Its cycle in microseconds.</param>
        /// <exception cref="EcmskException">The configuration is not valid.</exception>
        public void Adopt(IEnumerable<Slave> network, int cycle = 1000)
        {
            Slave[] list = Checked(network, cycle);
            lock (calls)
                SetNetwork(list, cycle);
        }

        /// <summary>Changes the state of the network and waits until it is reached.</summary>
        /// <param name="wanted">The state. From Init the network first has to go to PreOP, where it is configured.</param>
        /// <exception cref="EcmskException">The change has ended in another state, or did not end within
        /// <see cref="BoardOptions.StateLimit"/>.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void SetState(MasterState wanted)
        {
            lock (calls)
            {
                Drain();
                StateByte old = Snapshot.State;
                if (old.State == MasterState.Init && wanted > MasterState.PreOp)
                    throw WrongState("a change to SafeOP or OP", "PreOP", old);
                // The state byte may still show the failure of an earlier change.
                bool hasMoved = !old.IsFailed;
                var command = new Dictionary<int, Slot> { { 0, Of(Command.SetState, (uint)wanted) } };
                // It is sent once: a second SET_STATE would begin a failed change again.
                Snapshot ended = Run(
                    "a change of state", "give it more time, or look at the slaves' LEDs", options.StateLimit, command, false, InState,
                    report =>
                    {
                        hasMoved |= !report.State.Equals(old);
                        return report.State.Is(wanted) || hasMoved && report.State.IsFailed;
                    });
                if (!ended.State.Is(wanted))
                    throw EcmskException.Of(
                        ErrorKind.StateStuck,
                        "{0} was not reached, the board is in {1}; look whether each slave is configured as what it is "
                        + "(Configure, in PreOP), at the slaves' power, cables and LEDs, then SetState again",
                        StateByte.Name(wanted), ended.State);
            }
        }

        /// <summary>
        /// Switches axes on and waits until all are in Operation enabled. Axes that are on get no command. If one does not come on,
        /// or the call ends by another exception, all that got a command are switched off again.
        /// </summary>
        /// <param name="axes">The numbers of their slaves, from 1.</param>
        /// <remarks>A report shows the first channel of a pulse module alone.</remarks>
        /// <exception cref="AlarmException">An axis has an alarm.</exception>
        /// <exception cref="EcmskException">An axis does not come on within <see cref="BoardOptions.ServoLimit"/>, another thread
        /// has called <see cref="ServoOff"/> for it since this call began, the network is not in OP, or a slave has no
        /// axis.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void ServoOn(params int[] axes)
        {
            // What is switched off while this call waits for its turn stays off.
            int[] before = Offs(axes);
            Action mayBeSent = () => RefuseSwitchedOff(axes, before);
            lock (calls)
            {
                AwaitOffs(axes);
                Snapshot now = InOp("ServoOn", axes);
                mayBeSent();
                RefuseAlarm(now, axes);
                Dictionary<int, Slot> commands = ForAxes(Command.ServoOn, axes.Where(axis => !now.IsEnabled(axis)));
                if (commands.Count == 0)
                    return;
                try
                {
                    Run("switching on", DriveHint, options.ServoLimit, commands, true, Words(axes), report =>
                    {
                        mayBeSent();
                        RequireOp("ServoOn", report);
                        RefuseAlarm(report, axes);
                        return axes.All(report.IsEnabled);
                    }, mayBeSent);
                }
                catch
                {
                    // A drive that comes late must not come on by itself, whatever has ended this call.
                    try
                    {
                        SwitchOff(commands.Keys.ToArray(), OffLimit);
                    }
                    catch (Exception)
                    {
                        // The first exception says more.
                    }
                    throw;
                }
            }
        }

        /// <summary>Switches axes off and waits until none is in Operation enabled. A vertical axis without a brake drops.</summary>
        /// <param name="axes">The numbers of their slaves, from 1.</param>
        /// <remarks>
        /// It waits for no other call: its command is sent at once, or in the next frame of a stream that another thread steps. A
        /// <see cref="ServoOn"/> of these axes in another thread ends.
        /// </remarks>
        /// <exception cref="EcmskException">As for <see cref="ServoOn"/>, except for alarms: a drive with one is off.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void ServoOff(params int[] axes)
        {
            CheckOpen();
            // Reading comes second: what it raises in a program must not keep axes on.
            if (axes.Length == 0 || Snapshot.State.State != MasterState.Op)
                InOp("ServoOff", axes);
            foreach (int axis in axes)
                Axis(axis, "ServoOff");
            int[] all = axes.Distinct().ToArray();
            if (all.Length > 0)
                CountOffs(all, () => SwitchOff(all, options.ServoLimit));
        }

        void SwitchOff(int[] axes, TimeSpan limit)
        {
            Dictionary<int, Slot> commands = ForAxes(Command.ServoOff, axes);
            long before = Send(commands);
            Drain();
            // An axis that is off may still have an earlier SV_ON in the FIFO, and then this command behind it.
            Snapshot sent = Snapshot;
            RequireOp("ServoOff", sent);
            long executed = sent.Sequence + Frames.FifoEntries - sent.FifoFree + 1 + ServoReports;
            // Outside OP drives are off.
            Await("switching off", DriveHint, limit, commands, true, before, Words(axes), report =>
                report.State.State != MasterState.Op || report.Sequence >= executed && !axes.Any(report.IsEnabled));
        }

        /// <summary>Resets the alarms of axes. They are off after it. Axes without an alarm get no command.</summary>
        /// <param name="axes">The numbers of their slaves, from 1.</param>
        /// <exception cref="AlarmException">An alarm stays: remove its cause first.</exception>
        /// <exception cref="EcmskException">As for <see cref="ServoOn"/>.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void ClearAlarm(params int[] axes)
        {
            lock (calls)
            {
                Snapshot now = InOp("ClearAlarm", axes);
                Dictionary<int, Slot> commands = ForAxes(Command.AlarmClear, axes.Where(now.HasFault));
                if (commands.Count == 0)
                    return;
                try
                {
                    Run("an alarm clear", DriveHint, options.ServoLimit, commands, true, Words(axes), report =>
                    {
                        RequireOp("ClearAlarm", report);
                        return !axes.Any(report.HasFault);
                    });
                }
                catch (EcmskException error)
                {
                    if (error.Kind == ErrorKind.Timeout)
                        RefuseAlarm(Snapshot, axes);
                    throw;
                }
            }
        }

        /// <summary>Reads the 16 inputs of an IO slave, in OP.</summary>
        /// <param name="slave">Its number, from 1.</param>
        /// <returns>Bit k is input k.</returns>
        /// <exception cref="EcmskException">The slave is no IO slave, or the network is not in OP.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public ushort Inputs(int slave)
        {
            lock (calls)
            {
                RequireIo("Inputs", slave);
                var command = new Dictionary<int, Slot> { { slave, Of(Command.IoRead) } };
                Snapshot report = Run("IO_RD", LostHint, options.ServoLimit, command, true, InState, seen =>
                {
                    RequireOp("Inputs", seen);
                    return seen[slave].Id == (byte)Command.IoRead;
                });
                return (ushort)report[slave].Data1;
            }
        }

        /// <summary>Sets the 16 outputs of an IO slave, in OP.</summary>
        /// <param name="slave">Its number, from 1.</param>
        /// <param name="bits">Bit k is output k.</param>
        /// <exception cref="EcmskException">The slave is no IO slave, or the network is not in OP.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public void SetOutputs(int slave, ushort bits)
        {
            lock (calls)
            {
                RequireIo("SetOutputs", slave);
                var command = new Dictionary<int, Slot> { { slave, Of(Command.IoWrite, bits) } };
                Run("IO_WR", LostHint, options.ServoLimit, command, true, InState, seen =>
                {
                    RequireOp("SetOutputs", seen);
                    return seen[slave].Id == (byte)Command.IoWrite && (ushort)seen[slave].Data1 == bits;
                });
            }
        }

        /// <summary>
        /// Begins a stream of target positions that keeps up to <paramref name="depth"/> frames waiting in the board's FIFO.
        /// </summary>
        /// <param name="depth">
        /// 1 to 140. The program may be late by that many cycles, and a target takes effect that many cycles after its step.
        /// </param>
        /// <returns>The stream. Dispose of it before the board.</returns>
        /// <exception cref="EcmskException">The network is not in OP, another stream is open, or the depth is out of
        /// range.</exception>
        /// <exception cref="ObjectDisposedException">The board was disposed of before.</exception>
        public AxisStream Stream(int depth)
        {
            if (depth < 1 || depth > AxisStream.MaxDepth)
                throw EcmskException.Of(ErrorKind.Setting, "depth is {0}; set 1 to {1} frames", depth, AxisStream.MaxDepth);
            lock (calls)
            {
                InOp("a stream");
                lock (posts)
                {
                    if (stream != null)
                        throw new EcmskException(ErrorKind.Busy, "the stream is in use; dispose of the other one first");
                    return stream = new AxisStream(this, depth);
                }
            }
        }

        internal Snapshot NextInStream(long before)
        {
            return Next("a stream", options.ReadLimit, CancellationToken.None, before);
        }

        internal void DrainForStream()
        {
            Drain(false);
        }

        // The configuration of the axis of a slave.
        internal Slave Axis(int slave, string what)
        {
            Slave[] network = slaves;
            if (slave < 1 || slave > network.Length)
                throw EcmskException.Of(
                    ErrorKind.NoSuchSlave,
                    "there is no slave {0}, {1} are configured; call Configure, or Adopt for a board that runs", slave, network.Length);
            if (!network[slave - 1].HasAxis)
                throw EcmskException.Of(
                    ErrorKind.WrongKind, "slave {0} is configured as {1}, {2} is not for it; use it on a drive, Step or Hsp",
                    slave, network[slave - 1].Kind, what);
            return network[slave - 1];
        }

        static EcmskException WrongState(string what, string needs, StateByte found)
        {
            return EcmskException.Of(
                ErrorKind.WrongState, "{0} needs {1}, the board is in {2}; use SetState first", what, needs, found);
        }

        // The present report, of a network in OP with those axes.
        Snapshot InOp(string what, params int[] axes)
        {
            Drain();
            Snapshot now = Snapshot;
            RequireOp(what, now);
            foreach (int axis in axes)
                Axis(axis, what);
            return now;
        }

        // Outside OP slots of slaves are not refreshed.
        internal static void RequireOp(string what, Snapshot report)
        {
            if (report.State.State != MasterState.Op)
                throw WrongState(what, "OP", report.State);
        }

        void RequireIo(string what, int slave)
        {
            InOp(what);
            Slave[] network = slaves;
            if (slave < 1 || slave > network.Length || network[slave - 1].Kind != SlaveKind.Io)
                throw EcmskException.Of(ErrorKind.WrongKind, "slave {0} is not configured as Io, {1} is for those", slave, what);
        }

        static void RefuseAlarm(Snapshot report, IEnumerable<int> axes)
        {
            foreach (int axis in axes)
                if (report.HasFault(axis))
                    throw report.Alarm(axis);
        }

        Slave[] Checked(IEnumerable<Slave> network, int cycle)
        {
            if (network == null)
                throw new ArgumentNullException("network");
            Slave[] list = network.ToArray();
            int max = Frames.MaxSlaves(SlotSize);
            int factor = cycle / 250;
            if (cycle % 250 != 0 || factor < 1 || cycle > 1000000 || (factor & (factor - 1)) != 0)
                throw EcmskException.Of(
                    ErrorKind.Config, "the cycle is {0} us: it is 250 us * 2^n, at most 1 s; set 250, 500, 1000, 2000 or 4000", cycle);
            if (list.Length < 1 || list.Length > max)
                throw EcmskException.Of(
                    ErrorKind.Config, "{0} slaves: with slots of {1} bytes a board drives 1 to {2}; list the slaves",
                    list.Length, (int)SlotSize, max);
            for (int i = 0; i < list.Length; i++)
            {
                if (list[i] == null)
                    throw EcmskException.Of(ErrorKind.Config, "slave {0} is null; use Slave.Unused for one that is not used", i + 1);
                if (list[i].Guard == 0)
                    throw EcmskException.Of(
                        ErrorKind.Config, "slave {0} has a guard of 0 counts, which lets no target pass; set 1 or more, or null", i + 1);
                if (list[i].Kind == SlaveKind.Hsp && list[i].Mode == Mode.Cst)
                    throw EcmskException.Of(ErrorKind.Config, "slave {0} is an Hsp in Cst: set its mode to Csp or Csv", i + 1);
            }
            return list;
        }

        void SetNetwork(Slave[] list, int cycle)
        {
            slaves = list;
            cycleUs = cycle;
            // The present report is decoded with them, too.
            DecodeNewest(list);
        }

        static Slot Of(Command command, uint data1 = 0, uint data2 = 0)
        {
            return new Slot { Id = (byte)command, Data1 = data1, Data2 = data2 };
        }

        static Dictionary<int, Slot> ForAxes(Command command, IEnumerable<int> axes)
        {
            return axes.Distinct().ToDictionary(axis => axis, axis => Of(command));
        }

        static string InState(Snapshot report)
        {
            return "the board is in " + report.State;
        }

        static Func<Snapshot, string> Words(int[] axes)
        {
            return report => string.Join(", ", axes.Select(axis =>
                string.Format("slave {0} has the statusword 0x{1:X4}", axis, report[axis].Parm)));
        }

        // A command for the board itself, outside OP; returns its result, Data1 of the answer.
        uint AskBoard(string what, Command command, ushort parm, uint data1, uint data2)
        {
            var slot = new Slot { Id = (byte)command, Parm = parm, Data1 = data1, Data2 = data2 };
            // Outside OP slot 0 shows the last command. A second one of the same code could not be told from it.
            if (Snapshot[0].Id == slot.Id)
                Run(what, LostHint, ConfigureLimit, new Dictionary<int, Slot> { { 0, new Slot() } }, true, InState,
                    report => report[0].Id != slot.Id);
            Snapshot answer = Run(what, LostHint, ConfigureLimit, new Dictionary<int, Slot> { { 0, slot } }, true, InState,
                report => report[0].Id == slot.Id);
            return answer[0].Data1;
        }

        // Sends commands, each in its slot, and reads reports until one shows the effect. The caller holds `calls`.
        Snapshot Run(
            string what, string hint, TimeSpan limit, IDictionary<int, Slot> commands, bool mayResend,
            Func<Snapshot, string> seen, Func<Snapshot, bool> isDone, Action mayBeSent = null)
        {
            Drain();
            long before = Send(commands, mayBeSent);
            return Await(what, hint, limit, commands, mayResend, before, seen, isDone, mayBeSent);
        }

        // Reads reports until one shows the effect of commands that were sent when the report with the number `before` was the
        // newest one.
        Snapshot Await(
            string what, string hint, TimeSpan limit, IDictionary<int, Slot> commands, bool mayResend, long before,
            Func<Snapshot, string> seen, Func<Snapshot, bool> isDone, Action mayBeSent = null)
        {
            var clock = Stopwatch.StartNew();
            for (long reports = 1;; reports++)
            {
                Snapshot report = Next(what, options.ReadLimit, CancellationToken.None, before);
                before = report.Sequence;
                if (isDone(report))
                    return report;
                TimeSpan waited = isVirtual ? TimeSpan.FromMilliseconds(reports * cycleUs / 1000.0) : clock.Elapsed;
                if (limit >= TimeSpan.Zero && waited >= limit)
                    throw EcmskException.Of(
                        ErrorKind.Timeout, "{0}: not done after {1:0} ms, {2}; {3}", what, waited.TotalMilliseconds, seen(report), hint);
                if (mayResend && reports % ResendReports == 0)
                    Send(commands, mayBeSent);
            }
        }
    }
}
