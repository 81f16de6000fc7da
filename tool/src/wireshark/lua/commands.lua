-- Commands: what is shown of the arguments of each. A function returns why the board rejects the command, or nothing.
local A, MALFORMED = T.board.arguments, T.board.malformed
local commands = {}

-- The command with this code; nil if there is none.
local function command_of(code)
  return T.board.commands[code]
end

-- Whether all bits of a place with a mask are set.
local function is_set(slot, place)
  return number(slot, place) == place.mask
end

function commands.SET_STATE(line, slot)
  local state = number(slot, A.state)
  local known = T.board.states[state]
  if not known or not known.state or known.failed then
    return MALFORMED.state:format(state)
  end
  line:add("state", A.state, known.state)
end

-- The kinds that SET_AXIS declares, with the number of the first slave; or nil and why the board rejects it.
local function declared(slot, size)
  local group, nibbles, kinds = number(slot, A.group), number(slot, A.kinds), {}
  if group > A.last_group then
    return nil, MALFORMED.group:format(group)
  end
  for k = 0, 7 do
    local nibble, slave = bits.band(bits.rshift(nibbles, 4 * k), 0xF), group * 8 + k + 1
    local kind = T.board.kinds[nibble]
    if not kind and slave <= size.slots - 2 then
      return nil, MALFORMED.kind:format(slave, nibble)
    end
    kinds[k + 1] = kind or "none"
  end
  return kinds, group * 8 + 1
end

function commands.SET_AXIS(line, slot, size)
  local kinds, first = declared(slot, size)
  if not kinds then
    return first
  end
  line:add("group", A.group, number(slot, A.group))
  for k, kind in ipairs(kinds) do
    local item = line:add("kinds", A.kinds, kind, true)
    item:append_text((" (slave %d)"):format(first + k - 1))
  end
  line.words[#line.words + 1] = table.concat(kinds, " ")
end

function commands.SET_DC(line, slot)
  local us, shift = number(slot, A.cycle), number(slot, A.shift)
  if not A.cycles[us] then
    return MALFORMED.cycle:format(us)
  end
  line:add("cycle_us", A.cycle, us)
  local auto = shift == A.auto_shifts[1] or shift == A.auto_shifts[2]
  line:add("shift", A.shift, auto and "auto" or "without effect")
end

function commands.SET_EX(line, slot)
  line:add("check_commands", A.check_commands, is_set(slot, A.check_commands))
  line:add("fill_responses", A.fill_responses, is_set(slot, A.fill_responses))
end

function commands.SET_FIFO(line, slot)
  local code, free = number(slot, A.fifo_action), number(slot, A.threshold)
  local action = A.fifo_actions[code]
  if not action then
    return MALFORMED.fifo_action:format(code)
  end
  if action == "threshold" and free == 0 then
    return MALFORMED.zero_threshold
  end
  line:add("action", A.fifo_action, action)
  if action == "threshold" then
    line:add("threshold_entries", A.threshold, free)
  end
end

function commands.LIO_WR(line, slot)
  line:add("outputs", A.local_outputs, number(slot, A.local_outputs))
end

function commands.DRIVE_MODE(line, slot)
  local code = number(slot, A.mode)
  if not A.drive_modes[code] then
    return MALFORMED.mode:format(code)
  end
  line:add("mode", A.mode, T.board.modes[code])
  line:add("sync", A.sync, number(slot, A.sync) == 0 and "free run" or "dc")
end

function commands.IO_WR(line, slot)
  line:add("outputs", A.outputs, number(slot, A.outputs))
end

-- Targets of one or two axes. Outputs and axis 2, which most slaves do not have, are left out if they are 0.
local function motion(line, slot, size, name)
  local first, second = A.motion[1], A.motion[2]
  line:add(name, first.target, signed(slot, first.target))
  if number(slot, first.outputs) ~= 0 then
    line:add("outputs", first.outputs, number(slot, first.outputs))
  end
  if second.outputs.at + second.outputs.len > size.bytes then
    return
  end
  if number(slot, second.target) ~= 0 or number(slot, second.outputs) ~= 0 then
    line:add("axis2.target", second.target, signed(slot, second.target))
    line:add("axis2.outputs", second.outputs, number(slot, second.outputs))
  end
end

function commands.CSP(line, slot, size)
  return motion(line, slot, size, "target_counts")
end

function commands.CSV(line, slot, size)
  return motion(line, slot, size, "target_velocity")
end

function commands.CST(line, slot)
  line:add("target_torque_permille", A.torque, signed(slot, A.torque))
end

-- The object of an SDO transfer.
local function add_object(line, index, sub)
  line:word("object", ("0x%04X:%d"):format(index, sub))
  line:add("object.index", A.sdo.index, index, true)
  line.item:add(F["object.sub"], line.slot(A.sdo.sub.at, 1), sub)
end

-- Why the board rejects a transfer.
local function wrong_transfer(slot, size)
  local slave, sub = number(slot, A.sdo.slave), number(slot, A.sdo.sub)
  if slave == 0 or slave > size.slots - 2 then
    return MALFORMED.sdo_slave:format(slave)
  end
  return sub > 0xFF and MALFORMED.sub:format(sub) or nil
end

local function show_transfer(line, slot)
  line:add("slave", A.sdo.slave, number(slot, A.sdo.slave))
  add_object(line, number(slot, A.sdo.index), number(slot, A.sdo.sub))
end

function commands.SDO_RD(line, slot, size)
  local wrong = wrong_transfer(slot, size)
  if not wrong then
    show_transfer(line, slot)
  end
  return wrong
end

function commands.SDO_WR(line, slot, size)
  local wrong, bytes = wrong_transfer(slot, size), number(slot, A.sdo.size)
  if not wrong and not A.sdo.sizes[bytes] then
    wrong = MALFORMED.sdo_size:format(bytes)
  end
  if not wrong then
    show_transfer(line, slot)
    line:add("size_bytes", A.sdo.size, bytes)
    line:add("value", A.sdo.value, number(slot, A.sdo.value))
  end
  return wrong
end

-- What is said of a command that its slot does not take.
local FOREIGN = { ecm = "not a command for the ECM", slave = "not a command for a slave",
  sdo = "not a command for the SDO slot" }

-- The fields of a command in a slot of this role.
local function show_command(line, slot, size, role)
  local code = number(slot, T.board.head.id)
  local command = command_of(code)
  if role == "slave" then
    line:add("index", T.board.head.index, number(slot, T.board.head.index), true)
  end
  if not command or not command[role] then
    local why = command and FOREIGN[role] or "no such command"
    line.item:add_proto_expert_info(X.foreign, why)
    line.words[#line.words + 1] = "(" .. why .. ")"
    return
  end
  local show = commands[command.name]
  local wrong = show and show(line, slot, size)
  if wrong then
    line:word("malformed", wrong)
    line.item:add_proto_expert_info(X.malformed, wrong)
  end
end
