// Counters of the link and of the board, from `ecmsk_get_stats` and `ecmsk_get_counters`. Those structures are 64-bit words, with
// their size in the first one.

using System.Collections.Generic;

namespace Ecmsk
{
    /// <summary>The faults that a link has injected in one direction (keys <c>fault.</c> of its URI).</summary>
    public sealed class FaultCounts
    {
        internal FaultCounts(ulong[] words, int at)
        {
            Dropped = words[at];
            Corrupted = words[at + 1];
            Duplicated = words[at + 2];
            Delayed = words[at + 3];
        }

        /// <summary>Frames that were dropped.</summary>
        public ulong Dropped { get; private set; }
        /// <summary>Frames in which a bit was inverted.</summary>
        public ulong Corrupted { get; private set; }
        /// <summary>Frames that were delivered twice.</summary>
        public ulong Duplicated { get; private set; }
        /// <summary>Frames that were delayed.</summary>
        public ulong Delayed { get; private set; }
    }

    /// <summary>The statistics of a link since it was opened.</summary>
    public sealed class LinkStats
    {
        internal const int Words = 16;

        internal LinkStats(ulong[] words, long badCrc)
        {
            Written = words[1];
            Read = words[2];
            ReportsDropped = words[3];
            WriteErrors = words[4];
            ReadErrors = words[5];
            RecordDropped = words[6];
            WriteFaults = new FaultCounts(words, 7);
            ReadFaults = new FaultCounts(words, 11);
            Disconnected = words[15] != 0;
            BadCrc = badCrc;
        }

        /// <summary>Command frames written.</summary>
        public ulong Written { get; private set; }
        /// <summary>Reports read.</summary>
        public ulong Read { get; private set; }
        /// <summary>Reports dropped because nobody read them in time. The oldest is dropped first.</summary>
        public ulong ReportsDropped { get; private set; }
        /// <summary>Writes that ended with an error.</summary>
        public ulong WriteErrors { get; private set; }
        /// <summary>Reads that ended with an error, those that found no report included.</summary>
        public ulong ReadErrors { get; private set; }
        /// <summary>Frames missing in a recording because it could not be written fast enough.</summary>
        public ulong RecordDropped { get; private set; }
        /// <summary>Faults injected into command frames.</summary>
        public FaultCounts WriteFaults { get; private set; }
        /// <summary>Faults injected into reports.</summary>
        public FaultCounts ReadFaults { get; private set; }
        /// <summary>Whether an injected fault has disconnected the board.</summary>
        public bool Disconnected { get; private set; }
        /// <summary>Reports that were discarded because of a wrong CRC.</summary>
        public long BadCrc { get; private set; }
    }

    /// <summary>The counters of the board since it booted. Only a modelled board has them.</summary>
    public sealed class BoardCounters
    {
        const int RejectKinds = 16;
        const int BehindRejected = 3 + RejectKinds;
        internal const int Words = BehindRejected + 19;

        internal BoardCounters(Native native, ulong[] words)
        {
            Frames = words[1];
            Reports = words[2];
            var rejected = new Dictionary<string, ulong>();
            for (uint kind = 0; kind < RejectKinds; kind++)
            {
                string name = native.RejectName(kind);
                if (name != null)
                    rejected[name] = words[3 + kind];
            }
            Rejected = rejected;
            int at = BehindRejected;
            IgnoredHoming = words[at++];
            DiscardedBeforeEnabled = words[at++];
            Cleared = words[at++];
            Full = words[at++];
            Crc = words[at++];
            Incomplete = words[at++];
            Executed = words[at++];
            IdleCycles = words[at++];
            WhileBooting = words[at++];
            ForLost = words[at++];
            ModesNotRestored = words[at++];
            SdoRepeated = words[at++];
            SdoAborted = words[at++];
            AnswersLost = words[at++];
            OutputsLost = words[at++];
            CyclesLeftOut = words[at++];
            RingBroken = words[at++];
            InputsHeld = words[at++];
            InputsStale = words[at];
        }

        /// <summary>Command frames received.</summary>
        public ulong Frames { get; private set; }
        /// <summary>Reports sent.</summary>
        public ulong Reports { get; private set; }
        /// <summary>Commands rejected, by the name of the reason.</summary>
        public IReadOnlyDictionary<string, ulong> Rejected { get; private set; }
        /// <summary>Commands for a slave that were ignored because it was homing.</summary>
        public ulong IgnoredHoming { get; private set; }
        /// <summary>Targets discarded because the drive was not in Operation enabled yet.</summary>
        public ulong DiscardedBeforeEnabled { get; private set; }
        /// <summary>FIFO entries dropped by SET_FIFO 1 or by leaving OP.</summary>
        public ulong Cleared { get; private set; }
        /// <summary>Command frames lost because the FIFO was full.</summary>
        public ulong Full { get; private set; }
        /// <summary>Command frames refused because of a wrong CRC.</summary>
        public ulong Crc { get; private set; }
        /// <summary>Command frames of which only a part was received.</summary>
        public ulong Incomplete { get; private set; }
        /// <summary>FIFO entries executed.</summary>
        public ulong Executed { get; private set; }
        /// <summary>Cycles in OP that executed no entry: the FIFO was empty, or below its threshold.</summary>
        public ulong IdleCycles { get; private set; }
        /// <summary>Command frames lost because the board was booting; not counted in <see cref="Frames"/>.</summary>
        public ulong WhileBooting { get; private set; }
        /// <summary>Commands for slaves that had left the network.</summary>
        public ulong ForLost { get; private set; }
        /// <summary>How often the mode of operation could not be written back after homing.</summary>
        public ulong ModesNotRestored { get; private set; }
        /// <summary>SDO requests that repeat the one under way; nothing is lost by them.</summary>
        public ulong SdoRepeated { get; private set; }
        /// <summary>SDO transfers that the slave has aborted, or that were not answered in time.</summary>
        public ulong SdoAborted { get; private set; }
        /// <summary>Cycles without a report because a chip or a network card lost their answers.</summary>
        public ulong AnswersLost { get; private set; }
        /// <summary>FIFO entries that a chip or a network card had accepted and that a slave has missed, or may have.</summary>
        public ulong OutputsLost { get; private set; }
        /// <summary>Cycles that were skipped on a network card because the machine was too late for them.</summary>
        public ulong CyclesLeftOut { get; private set; }
        /// <summary>Cycles in OP in which the ring of cables between two network cards was broken.</summary>
        public ulong RingBroken { get; private set; }
        /// <summary>Cycles in OP in which a slave kept its previous inputs because the working counter was wrong.</summary>
        public ulong InputsHeld { get; private set; }
        /// <summary>How often the inputs of a slave were missing for so long that the slave counts as lost.</summary>
        public ulong InputsStale { get; private set; }
    }
}
