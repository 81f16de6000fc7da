-- Responses: slot 0, the slots of slaves by their kinds, the SDO slot.
local R, HEAD = T.board.responses, T.board.head

-- The drive state of a statusword; nil if CiA 402 defines none.
local function drive_state(statusword)
  return T.board.statusword.states[bits.band(statusword, T.board.statusword.mask)]
end

-- What is known of a state in slot 0.
local function state_of(code)
  return T.board.states[code] or { text = T.board.unknown_state:format(code), failed = true }
end

-- The kind of a slave by the fields of its slot, and how it is known.
local function kind_of(slot, size)
  local command = command_of(number(slot, HEAD.id))
  if command and command.only then
    return T.board.kinds[command.only], "implied"
  end
  local data1, data2 = number(slot, HEAD.data1), number(slot, HEAD.data2)
  if size.bytes > HEAD.data3.at and number(slot, HEAD.data3) ~= 0 then
    return "hsp", "guessed"
  end
  if command and command.axes or number(slot, HEAD.parm) ~= 0 then
    return "drive", "guessed"
  end
  if data1 ~= 0 and data1 <= 0xFFFF and data2 == 0 then
    return "io", "guessed"
  end
  return nil, "unknown"
end

local function add_statusword(line, place)
  local value = number(line.slot, place)
  local item = line:add("statusword", place, value, true)
  for _, row in ipairs(T.board.statusword.bits) do
    item:add_le(F["statusword." .. row[1]], part(line.slot, place))
  end
  local state = drive_state(value)
  if state then
    line:word("drive_state", state)
  end
  return state
end

local layouts = {}

-- A layout returns the state of the drive, and the place and the value of its error code.
function layouts.drive(line, slot)
  local state = add_statusword(line, R.drive.statusword)
  line:add("position_counts", R.drive.position, signed(slot, R.drive.position))
  line:add("torque_permille", R.drive.torque, signed(slot, R.drive.torque), true)
  local code = number(slot, R.drive.error_code)
  line:add("error_code", R.drive.error_code, code, code == 0):append_text(" (" .. error_name(code) .. ")")
  return state, code
end
layouts.step = layouts.drive

function layouts.io(line, slot)
  local command = command_of(number(slot, HEAD.id))
  local written = command and command.name == "IO_WR"
  line:add(written and "outputs" or "inputs", R.io.bits, number(slot, R.io.bits))
end

function layouts.hsp(line, slot, size)
  local first, second = R.hsp.axes[1], R.hsp.axes[2]
  local state = add_statusword(line, R.hsp.statusword)
  line:add("position_counts", first.position, signed(slot, first.position))
  line:add("inputs", first.inputs, number(slot, first.inputs))
  if second.inputs.at + second.inputs.len <= size.bytes
    and (number(slot, second.position) ~= 0 or number(slot, second.inputs) ~= 0) then
    line:add("axis2.position_counts", second.position, signed(slot, second.position))
    line:add("axis2.inputs", second.inputs, number(slot, second.inputs))
  end
  return state, 0
end

-- Whether all bytes behind the command and its index are 0.
local function is_without_data(slot, size)
  return not slot:raw(HEAD.parm.at, size.bytes - HEAD.parm.at):find("[^\0]")
end

-- The slot of a slave. `kind` is its kind by SET_AXIS, if known; `in_op`: zeros are values. Returns the state of the
-- drive and its error code.
local function show_slave(line, slot, size, kind, in_op)
  local from = "given"
  if not kind then
    kind, from = kind_of(slot, size)
  end
  local index = number(slot, HEAD.index)
  if ecmsk.prefs.firmware == 15 then
    line:add("mode", HEAD.index, T.board.modes[index] or tostring(index), true)
  else
    line:add("index", HEAD.index, index, true)
  end
  if kind then
    line:word("kind", kind, true)
  end
  line:word("kind_from", from, true)
  local without_data = is_without_data(slot, size)
  if without_data and not (in_op and kind and kind ~= "none") then
    return
  end
  if layouts[kind] then
    return layouts[kind](line, slot, size)
  end
  line.item:add(F.raw, slot)
end

-- Slot 0: the state, the counters and the FIFO.
local function show_master(line, slot)
  local code, place = number(slot, R.master.state), R.master
  local state = state_of(code)
  line:add("state", place.state, state.text)
  line:add("state_code", place.state, code, true)
  line:add("state_failed", place.state, state.failed, true)
  local errors, result = number(slot, place.crc_errors), number(slot, place.result)
  local free, full = number(slot, place.fifo_free), number(slot, place.full_count)
  line:add("crc_errors", place.crc_errors, errors, errors == 0)
  line:add("result", place.result, result, result == 0)
  line:add("fifo_free_entries", place.fifo_free, free)
  line:add("full_count", place.full_count, full, full == 0)
  return { code = code, state = state, crc_errors = errors, fifo_free = free, full_count = full }
end

-- The SDO slot. Returns the abort as text, if the transfer was aborted.
local function show_sdo(line, slot)
  local command = command_of(number(slot, HEAD.id))
  local flags = slot(R.sdo.aborted.at, 1):le_uint()
  local is_transfer = command and command.sdo and command.name ~= "GET_STATUS"
  local sub = number(slot, A.sdo.sub)
  if not is_transfer or bits.band(flags, 0xFF - R.sdo.aborted.mask) ~= 0 or sub > 0xFF then
    if number(slot, HEAD.id) ~= 0 or not is_without_data(slot, { bytes = slot:len() }) then
      line.item:add(F.raw, slot)
    end
    return
  end
  line:add("slave", A.sdo.slave, number(slot, A.sdo.slave))
  local index, value = number(slot, A.sdo.index), number(slot, A.sdo.value)
  add_object(line, index, sub)
  if flags == 0 then
    line:add("value", A.sdo.value, value)
    return
  end
  local text = T.board.aborts[value]
  line:add("abort_code", A.sdo.value, value, text)
  if text then
    line:word("abort_text", text)
  end
  return ("slave %d, 0x%04X:%d: 0x%08X%s"):format(number(slot, A.sdo.slave), index, sub, value,
    text and " (" .. text .. ")" or "")
end
