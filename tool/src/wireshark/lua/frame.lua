-- Frames. What a frame does not show by itself is kept by its number, since Wireshark reads a file once in order, and
-- then any packet again.
local boards, memory = {}, {}
-- The remarks on most frames.
local NONE = {}

function ecmsk.init()
  boards, memory = {}, {}
end

local bus_of, device_of = Field.new("usb.bus_id"), Field.new("usb.device_address")

-- The board of this packet.
local function board_of()
  local bus, device = bus_of(), device_of()
  local key = tostring(bus and bus.value) .. "." .. tostring(device and device.value)
  boards[key] = boards[key] or { votes = {}, kinds = {}, alarms = {} }
  return boards[key]
end

-- Notes what a command changes of what is known: SET_AXIS declares kinds in Init and PreOP, SW_RESET makes all unknown.
-- Earlier frames keep their own table of kinds.
local function follow_command(board, frame, size)
  local slot = frame(0, size.bytes)
  local command = command_of(number(slot, HEAD.id))
  local name = command and command.name
  if name == "SW_RESET" then
    board.kinds = {}
  elseif name == "SET_AXIS" and board.state ~= "SafeOP" and board.state ~= "OP" then
    local kinds, first = declared(slot, size)
    local all = {}
    for slave = 1, size.slots - 2 do
      all[slave] = kinds and kinds[slave - first + 1] or board.kinds[slave]
    end
    board.kinds = all
  end
end

-- Remarks on a response: what is new in slot 0.
local function remark_master(board, now, say)
  local before = board.last or {}
  if now.state.failed and before.code ~= now.code then
    local lost = now.state.state == "OP" or now.state.state == "SafeOP"
    say(0, lost and "slave_lost" or "state_failed", now.state.why or now.state.text)
  end
  local op = now.state.state == "OP"
  if op and before.full_count and before.full_count ~= now.full_count then
    say(0, "command_lost", ("the full count went from %d to %d: the FIFO was full"):format(before.full_count,
      now.full_count))
  end
  if op and now.fifo_free == 0 and before.fifo_free ~= 0 then
    say(0, "fifo_full", ("all %d entries are used: the board loses the next command"):format(T.board.fifo_entries))
  end
  if before.crc_errors and before.crc_errors ~= now.crc_errors then
    say(0, "crc_rejected", ("byte 1 of slot 0 went from %d to %d"):format(before.crc_errors, now.crc_errors))
  end
  board.last = now
end

-- Remarks on a response: a new alarm of a slave, or its end.
local function remark_alarm(board, slave, state, code, say)
  local faults, text = T.board.statusword.faults, nil
  if state == faults[1] or state == faults[2] then
    text = ("slave %d: alarm 0x%04X: %s"):format(slave, code, code == 0 and "no error code" or error_name(code))
  end
  if text and board.alarms[slave] ~= text then
    say(slave, "alarm", text)
  elseif state and not text and board.alarms[slave] then
    say(slave, "alarm_cleared", ("slave %d has no alarm any more"):format(slave))
  end
  if state then
    board.alarms[slave] = text
  end
end

local function remark_sdo(board, slot, size, aborted, say)
  local bytes = slot:raw()
  if aborted and board.sdo ~= bytes then
    say(size.slots - 1, "sdo_aborted", aborted)
  end
  board.sdo = bytes
end

-- Shows the CRC of a frame.
local function show_crc(tree, frame, bytes, size)
  local found, expected = bytes:byte(T.board.crc.at + 1), crc8.of(bytes, { size.frame })[1]
  local status = found == expected and "right" or found == 0 and "absent" or "wrong"
  local item = tree:add(F.crc, frame(T.board.crc.at, 1), found)
  item:append_text(" (" .. status .. ")")
  item:add(F.crc_expected, frame(T.board.crc.at, 1), expected):set_generated()
  item:add(F.crc_status, frame(T.board.crc.at, 1), status):set_generated()
  if status == "wrong" then
    item:add_proto_expert_info(X.crc_wrong, ("CRC-8 is 0x%02X, the bytes give 0x%02X"):format(found, expected))
  end
end

-- The role of slot `n`, and the name of its line.
local function role_of(n, size)
  if n == 0 then
    return "ecm", "ECM"
  elseif n == size.slots - 1 then
    return "sdo", "SDO"
  end
  return "slave", "slave " .. n
end

-- Shows the meaning of a slot of a response. In the first pass, when `say` is there, it compares with what was before.
local function show_response(line, slot, n, role, seen, say)
  local board, size = seen.board, seen.size
  if role == "ecm" then
    local now = show_master(line, slot)
    seen.in_op = now.state.state == "OP"
    if say then
      remark_master(board, now, say)
      board.state = now.state.state
    end
  elseif role == "slave" then
    local state, code = show_slave(line, slot, size, seen.kinds[n], seen.in_op)
    if say then
      remark_alarm(board, n, state, code, say)
    end
  else
    local aborted = show_sdo(line, slot)
    if say then
      remark_sdo(board, slot, size, aborted, say)
    end
  end
end

-- The name of a command, or of the response in OP, which shows none.
local function name_of(code, role)
  if code == T.board.cyclic.code and role == "ecm" then
    return T.board.cyclic.name
  end
  local command = command_of(code)
  return command and command.name or "UNKNOWN"
end

-- Shows slot `n`; returns its words for the column Info, if it has any.
local function show_slot(tree, slot, n, seen, is_response, say)
  local role, whose = role_of(n, seen.size)
  local line, code = Line.new(tree, slot), number(slot, HEAD.id)
  local name = name_of(code, role)
  line:word("n", n, true)
  line:word("role", role, true)
  line:add("cmd", HEAD.id, name, true)
  line:add("cmd_code", HEAD.id, code, true)
  if is_response then
    show_response(line, slot, n, role, seen, say)
  else
    show_command(line, slot, seen.size, role)
  end
  local words = table.concat(line.words, ", ")
  line.item:set_text(("%-8s  %s %s"):format(whose, name, words))
  for _, remark in ipairs(seen.remarks) do
    if remark.slot == n then
      line.item:add_proto_expert_info(X[remark.what], remark.text)
    end
  end
  if role == "ecm" then
    return ("%s %s %s"):format(whose, name, words)
  end
  return code ~= 0 and whose .. " " .. name or nil
end

-- Shows the slots of a frame; returns the words for the column Info.
local function show_slots(tree, frame, seen, is_response, first_time)
  local info, size = {}, seen.size
  local function say(n, what, text)
    seen.remarks = seen.remarks == NONE and {} or seen.remarks
    seen.remarks[#seen.remarks + 1] = { slot = n, what = what, text = text }
  end
  for n = 0, size.slots - 1 do
    local slot = frame(n * size.bytes, size.bytes)
    if n == 0 or ecmsk.prefs.idle or slot:raw():find("[^\0]") then
      info[#info + 1] = show_slot(tree, slot, n, seen, is_response, first_time and say)
    end
  end
  return table.concat(info, "; ")
end

-- Whether a transfer is as long as a frame; the report id of 0 before one is cut off.
local function frame_in(buffer)
  local length = buffer:len()
  if length == WIDE.frame + 1 and buffer(0, 1):uint() == 0 then
    return buffer(1):tvb()
  end
  return (length == NARROW.frame or length == WIDE.frame) and buffer or nil
end

-- What is known of the frame in this packet, and whether it is seen for the first time.
local function recall(pinfo, frame, is_response)
  if memory[pinfo.number] then
    return memory[pinfo.number], false
  end
  local board = board_of()
  local seen = { board = board, size = size_of(board, frame:raw()), remarks = NONE }
  if not is_response then
    follow_command(board, frame, seen.size)
  end
  seen.kinds = board.kinds
  memory[pinfo.number] = seen
  return seen, true
end

function ecmsk.dissector(buffer, pinfo, root)
  local frame = frame_in(buffer)
  if not frame then
    return 0
  end
  local is_response = pinfo.p2p_dir == P2P_DIR_RECV
  local seen, first_time = recall(pinfo, frame, is_response)
  local size, direction = seen.size, is_response and "response" or "command"
  pinfo.cols.protocol = "ECM-SK"
  local tree = root:add(ecmsk, frame(0, size.frame))
  tree:append_text((", %s, slots of %d bytes"):format(direction, size.bytes))
  tree:add(F.direction, direction):set_generated()
  tree:add(F.slot_bytes, size.bytes):set_generated()
  show_crc(tree, frame, frame:raw(), size)
  pinfo.cols.info = direction .. ": " .. show_slots(tree, frame, seen, is_response, first_time)
  return buffer:len()
end
