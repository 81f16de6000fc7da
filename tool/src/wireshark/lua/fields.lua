-- The protocol of a board, and its fields.
local ecmsk = Proto("ecmsk", "ECM-SK")

local F = {
  direction = ProtoField.string("ecmsk.direction", "Direction"),
  slot_bytes = ProtoField.uint8("ecmsk.slot_bytes", "Bytes of a slot"),
  crc = ProtoField.uint8("ecmsk.crc", "CRC-8", base.HEX),
  crc_expected = ProtoField.uint8("ecmsk.crc.expected", "Expected CRC-8", base.HEX),
  crc_status = ProtoField.string("ecmsk.crc.status", "CRC is"),
  slot = ProtoField.none("ecmsk.slot", "Slot"),
}

-- The fields of a slot: name, label, and type with its base. The names are those of the JSON of `ecmsk dump`.
local SLOT_FIELDS = {
  { "n", "Slot", "uint8", base.DEC },
  { "role", "Slot of", "string" },
  { "cmd", "Command", "string" },
  { "cmd_code", "Code of the command", "uint8", base.HEX },
  { "malformed", "Malformed", "string" },
  { "index", "Command index", "uint8", base.DEC },
  { "mode", "Mode of operation", "string" },
  { "state", "State", "string" },
  { "state_code", "Code of the state", "uint8", base.HEX },
  { "state_failed", "A slave failed", "bool" },
  { "crc_errors", "CRC errors", "uint8", base.DEC },
  { "result", "Result", "uint32", base.DEC },
  { "fifo_free_entries", "Free entries of the FIFO", "uint16", base.DEC },
  { "full_count", "Full count", "uint16", base.DEC },
  { "group", "Group", "uint8", base.DEC },
  { "kinds", "Kind declared", "string" },
  { "cycle_us", "Cycle, us", "uint32", base.DEC },
  { "shift", "Shift of SYNC0", "string" },
  { "check_commands", "CRC of commands is checked", "bool" },
  { "fill_responses", "CRC of responses is filled in", "bool" },
  { "action", "Action", "string" },
  { "threshold_entries", "Threshold, free entries", "uint32", base.DEC },
  { "sync", "Synchronisation", "string" },
  { "outputs", "Outputs", "uint16", base.HEX },
  { "inputs", "Inputs", "uint16", base.HEX },
  { "target_counts", "Target, counts", "int32", base.DEC },
  { "target_velocity", "Target velocity", "int32", base.DEC },
  { "target_torque_permille", "Target torque, 0.1 %", "int16", base.DEC },
  { "kind", "Kind of slave", "string" },
  { "kind_from", "Kind is known by", "string" },
  { "statusword", "Statusword", "uint16", base.HEX },
  { "drive_state", "State of the drive", "string" },
  { "position_counts", "Position, counts", "int32", base.DEC },
  { "torque_permille", "Torque, 0.1 %", "int16", base.DEC },
  { "error_code", "Error code", "uint16", base.HEX },
  { "axis2", "Axis 2", "none" },
  { "axis2.target", "Target of axis 2", "int32", base.DEC },
  { "axis2.position_counts", "Position of axis 2, counts", "int32", base.DEC },
  { "axis2.outputs", "Outputs of axis 2", "uint16", base.HEX },
  { "axis2.inputs", "Inputs of axis 2", "uint16", base.HEX },
  { "slave", "Slave", "uint8", base.DEC },
  { "object", "Object", "string" },
  { "object.index", "Index of the object", "uint16", base.HEX },
  { "object.sub", "Sub-index", "uint8", base.DEC },
  { "size_bytes", "Size, bytes", "uint8", base.DEC },
  { "value", "Value", "uint32", base.DEC },
  { "abort_code", "Abort code", "uint32", base.HEX },
  { "abort_text", "Aborted", "string" },
  { "raw", "Bytes", "bytes" },
}
for _, row in ipairs(SLOT_FIELDS) do
  F[row[1]] = ProtoField[row[3]]("ecmsk.slot." .. row[1], row[2], row[4])
end
for _, row in ipairs(T.board.statusword.bits) do
  local label = row[1]:gsub("_", " "):gsub("^%l", string.upper)
  F["statusword." .. row[1]] = ProtoField.bool("ecmsk.slot.statusword." .. row[1], label, 16, nil, row[2])
end
ecmsk.fields = F

-- Remarks of the expert information.
local X = {
  crc_wrong = ProtoExpert.new("ecmsk.crc_wrong", "The CRC is wrong", expert.group.CHECKSUM, expert.severity.ERROR),
  malformed = ProtoExpert.new("ecmsk.malformed", "The board rejects the command", expert.group.PROTOCOL,
    expert.severity.WARN),
  foreign = ProtoExpert.new("ecmsk.foreign", "No command for this slot", expert.group.PROTOCOL, expert.severity.WARN),
  crc_rejected = ProtoExpert.new("ecmsk.crc_rejected", "The board counts a wrong CRC", expert.group.CHECKSUM,
    expert.severity.WARN),
  fifo_full = ProtoExpert.new("ecmsk.fifo_full", "The FIFO is full", expert.group.SEQUENCE, expert.severity.WARN),
  command_lost = ProtoExpert.new("ecmsk.command_lost", "A command was lost", expert.group.SEQUENCE,
    expert.severity.ERROR),
  slave_lost = ProtoExpert.new("ecmsk.slave_lost", "A slave is lost", expert.group.SEQUENCE, expert.severity.ERROR),
  state_failed = ProtoExpert.new("ecmsk.state_failed", "A state was not reached", expert.group.SEQUENCE,
    expert.severity.ERROR),
  alarm = ProtoExpert.new("ecmsk.alarm", "A drive has an alarm", expert.group.RESPONSE_CODE, expert.severity.ERROR),
  alarm_cleared = ProtoExpert.new("ecmsk.alarm_cleared", "An alarm is cleared", expert.group.RESPONSE_CODE,
    expert.severity.NOTE),
  sdo_aborted = ProtoExpert.new("ecmsk.sdo_aborted", "An SDO transfer was aborted", expert.group.RESPONSE_CODE,
    expert.severity.NOTE),
}
ecmsk.experts = X

ecmsk.prefs.slot_bytes = Pref.enum("Bytes of a slot", 0, "12 or 16; without a CRC the frames may not show it", {
  { 1, "as the frames show", 0 }, { 2, "12", 12 }, { 3, "16", 16 },
})
ecmsk.prefs.firmware = Pref.enum("Firmware of the board", 17,
  "With 1.5, byte 1 of a slave's slot in a response is the mode of operation", { { 1, "1.7", 17 }, { 2, "1.5", 15 } })
ecmsk.prefs.idle = Pref.bool("Show idle slots", false, "Slots whose bytes are all 0")

-- A slot as it is shown: its line, and the words of that line.
local Line = {}
Line.__index = Line

function Line.new(tree, slot)
  local item = tree:add(F.slot, slot)
  return setmetatable({ item = item, slot = slot, words = {} }, Line)
end

-- Adds a field at a place of the slot, and to the line unless `quiet`.
function Line:add(name, place, value, quiet)
  local range = place and part(self.slot, place) or self.slot
  if not quiet then
    self.words[#self.words + 1] = name:gsub("_", " ") .. " " .. tostring(value)
  end
  return self.item:add(F[name], range, value)
end

-- Adds a word that no bytes have.
function Line:word(name, value, quiet)
  self:add(name, nil, value, quiet):set_generated()
end
