-- A plugin of Wireshark and tshark for frames of the EtherCAT board ECM-SK and for packets of the chip ECM-XF.
--
-- Made from the tables and files in tool/src/wireshark; a change belongs there. `ECMSK_BLESS=1 cargo test -p ecmsk-tool
-- --test tool wireshark` writes this file. `ecmsk wireshark install` copies it to Wireshark's folder for plugins.
--
-- Names of fields are those of `ecmsk dump --json`, behind `ecmsk.slot.`: `ecmsk.slot.n == 1 and
-- ecmsk.slot.position_counts > 1000`. Docs: docs/WIRESHARK.md of the project.
--
-- Licence: MIT or Apache-2.0.

-- Loaded twice, as from two folders, the second copy does nothing.
if ecmsk_is_loaded then
  return
end
ecmsk_is_loaded = true

-- The tables. T.board is for frames of a board, T.chip for packets of a chip.
local T = {}
