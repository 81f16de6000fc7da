-- Packets of a chip, as a recording has them: a byte for the direction, then the bytes of an exchange.
local TO_CHIP, FROM_CHIP = 0, 1
local chips

function chip.init()
  -- The header of the last answer; the parameters of commands by code and index; what is known of packets by number.
  chips = { last = {}, asked = {}, memory = {} }
end

-- The values of a header by name, and where they stand.
local function read_header(packet, header)
  local values = {}
  for _, row in ipairs(header) do
    values[row.name] = row.kind ~= "bytes" and packet(row.at, row.len):le_uint() or nil
    values[row.name .. "_at"] = row.at
  end
  return values
end

-- Shows the fields of a header.
local function show_header(tree, packet, header)
  for _, row in ipairs(header) do
    local range = packet(row.at, row.len)
    local item = row.kind == "bytes" and tree:add(G[row.name], range) or tree:add_le(G[row.name], range)
    if row.kind == "state" then
      local value = range:le_uint()
      local failed = bits.band(value, C.state_error) ~= 0 and ", with an error" or ""
      item:append_text((" (%s%s)"):format(C.states[bits.band(value, 0xF)] or "no state", failed))
    end
    for _, bit in ipairs(row.bits or {}) do
      item:add_le(G[row.name .. "." .. bit[1]], range)
    end
  end
end

-- The part of a packet that a field has; `base` is where its fields begin in the data. nil if the packet ends before.
local function range_of(packet, field, header, base, list)
  if field.place ~= "data" then
    local at = header[field.place .. "_at"] + field.at
    return packet(at, math.max(field.bytes, 1))
  end
  local begin, data_end = C.header_bytes + base + field.at, packet:len() - C.trailer_bytes
  local valid_end = math.min(C.header_bytes + header.len, data_end)
  if field.bytes > 0 then
    -- A request is read from the whole data segment, an answer as far as it is valid.
    return begin + field.bytes <= (header.ret and valid_end or data_end) and packet(begin, field.bytes) or nil
  end
  for _, other in ipairs(list) do
    if other.counts == field.name then
      local range = range_of(packet, other, header, base, list)
      valid_end = range and begin + range:le_uint() or 0
    end
  end
  return begin <= valid_end and valid_end <= data_end and packet(begin, valid_end - begin) or nil
end

local show = {}

local function show_number(tree, field, range, value)
  if field.mask then
    value = bits.rshift(bits.band(value, field.mask), field.shift)
  end
  local item = tree:add(G[field.key], range, value)
  for _, bit in ipairs(field.bits or {}) do
    if field.mask == nil then
      item:add_le(G[field.key .. "." .. bit[1]], range)
    end
  end
end

function show.number(tree, field, range)
  show_number(tree, field, range, range:le_uint())
end
show.hex, show.drive_state, show.abort = show.number, show.number, show.number

function show.signed(tree, field, range)
  tree:add(G[field.key], range, range:le_int())
end

function show.bytes(tree, field, range)
  tree:add(G[field.key], range)
end

function show.text(tree, field, range)
  tree:add(G[field.key], range, range:len() > 0 and range:stringz() or "")
end

function show.number_or_text(tree, field, range)
  local length = range:len()
  local is_number = length == 1 or length == 2 or length == 4
  tree:add(G[field.key], range, is_number and tostring(range:le_uint()) or length > 0 and range:string() or "")
end

function show.objects(tree, field, range, packet, base)
  local count = packet(C.header_bytes + base + field.count_at, 2):le_uint()
  for n = 0, math.min(count, math.floor(range:len() / 4)) - 1 do
    tree:add_le(G[field.key], range(4 * n, 4))
  end
end

local function show_fields(tree, packet, list, header, base)
  for _, field in ipairs(list or {}) do
    local range = range_of(packet, field, header, base, list)
    -- Bytes of variable length may be none.
    if range and (range:len() > 0 or field.kind ~= "bytes") then
      show[field.kind](tree, field, range, packet, base)
    end
  end
end

-- The form of an answer of that length.
local function form_of(row, length)
  for _, form in ipairs(row.answers or {}) do
    if not form.len or form.len == length then
      return form
    end
  end
end

-- Remarks on an emergency, one of the parts of an answer.
local function remark_emergency(item, packet, form, header, base)
  local values = {}
  for _, field in ipairs(form.fields) do
    local range = range_of(packet, field, header, base, form.fields)
    values[field.name] = range and field.kind ~= "bytes" and range:le_uint() or nil
    if field.name == "number" and field.names[values.number] then
      return
    end
  end
  item:add_proto_expert_info(Y.emergency, ("slave %d: emergency 0x%04X: %s"):format(values.slave, values.code,
    error_name(values.code)))
end

local function show_answer(tree, packet, row, header)
  local form = form_of(row, header.len)
  if not form then
    return
  end
  if not form.every then
    return show_fields(tree, packet, form.fields, header, 0)
  end
  for base = 0, header.len - form.every, form.every do
    local item = tree:add(G.repeated, packet(C.header_bytes + base, form.every))
    item:set_text(("Part %d"):format(base / form.every))
    show_fields(item, packet, form.fields, header, base)
    if header.code == C.emergency then
      remark_emergency(item, packet, form, header, base)
    end
  end
end

-- Whether the check word fits: its type, or nil and what is wrong. A CRC-32 may cover the data as far as they are
-- valid, also rounded up to four bytes.
local function check_of(packet, header, is_answer)
  local length, data_end = packet:len(), packet:len() - C.trailer_bytes
  local found, kind = packet(data_end, 4):le_uint(), nil
  if packet(0, 4):le_uint() ~= C.start_word then
    return nil, ("the start word is 0x%08X"):format(packet(0, 4):le_uint())
  elseif packet(length - 4, 4):le_uint() ~= C.end_word then
    return nil, ("the end word is 0x%08X"):format(packet(length - 4, 4):le_uint())
  end
  if is_answer then
    kind = bits.band(header.status, C.check.mask)
  end
  local fixed_allowed = kind == nil or kind == C.check.fixed
  if fixed_allowed and found == C.fixed_check then
    return "fixed"
  end
  local crc_allowed = kind == C.check.crc32 or kind == nil and header.code ~= C.always_fixed
  if crc_allowed then
    local valid = math.min(C.header_bytes + header.len, data_end)
    local whole = math.min(math.ceil(valid / 4) * 4, data_end)
    for _, crc in ipairs(crc32.of(packet:raw(), { valid, whole, data_end })) do
      if crc == found then
        return "CRC-32"
      end
    end
  end
  if is_answer and found == C.not_ready then
    return "not ready"
  end
  return nil, ("the check word is 0x%08X"):format(found)
end

-- Remarks on an answer: what is new in its header.
local function remark_answer(header, say)
  local before = chips.last
  local errors = bits.band(header.errors, C.errors)
  local new = bits.band(errors, 0xFF - (before.errors or 0))
  for _, row in ipairs(C.answer_header) do
    for _, bit in ipairs(row.name == "errors" and row.bits or {}) do
      if bits.band(new, bit[2]) ~= 0 then
        say(bit[2] == C.fifo_error and "fifo_full" or "error", "new error bit: " .. bit[1]:gsub("_", " "))
      end
    end
  end
  if before.wkc_errors and before.wkc_errors ~= header.wkc_errors then
    say("slave_lost", ("cycles with a wrong working counter: from %d to %d"):format(before.wkc_errors,
      header.wkc_errors))
  end
  local failed = bits.band(header.state, C.state_error)
  if failed ~= 0 and before.failed == 0 then
    say("slave_lost", "a slave is in another state than the network, or has an error")
  end
  chips.last = { errors = errors, wkc_errors = header.wkc_errors, failed = failed }
end

-- What is known of a packet besides its bytes: remarks on it and, of an answer, the parameter of its command, which
-- selects the function of a code that has several.
local function recall_packet(pinfo, header, check, is_answer)
  local kept = chips.memory[pinfo.number]
  if kept then
    return kept
  end
  kept = { remarks = NONE, parameter = header.parameter }
  chips.memory[pinfo.number] = kept
  if check and check ~= "not ready" then
    local asked = header.code .. "#" .. header.index
    if is_answer then
      kept.parameter = chips.asked[asked]
      remark_answer(header, function(what, text)
        kept.remarks = kept.remarks == NONE and {} or kept.remarks
        kept.remarks[#kept.remarks + 1] = { what = what, text = text }
      end)
    else
      chips.asked[asked] = header.parameter
    end
  end
  return kept
end

-- Shows a packet that is not damaged; returns its words for the column Info.
local function show_packet(tree, packet, header, parameter, is_answer)
  local row = functions[tostring(header.code)] or functions[header.code .. ":" .. tostring(parameter)]
  local name = row and row.name or C.commands[header.code] or ("code %d"):format(header.code)
  tree:add(G.command, name):set_generated()
  if row then
    tree:add(G.what, row.what):set_generated()
  end
  local nop = is_answer and bits.band(header.status, C.nop) ~= 0
  if is_answer then
    tree:add(G.nop, nop):set_generated()
  end
  if row and not is_answer then
    show_fields(tree, packet, row.request, header, 0)
  elseif row and not nop then
    show_answer(tree, packet, row, header)
  end
  local valid = math.min(header.len, packet:len() - C.header_bytes - C.trailer_bytes)
  if valid > 0 and not nop then
    tree:add(G.data, packet(C.header_bytes, valid))
  end
  return ("#%d %s%s"):format(header.index, name, nop and ": no result" or "")
end

local function dissect_packet(packet, pinfo, tree, is_answer)
  local rows = is_answer and C.answer_header or C.command_header
  local header = read_header(packet, rows)
  local check, wrong = check_of(packet, header, is_answer)
  local word = tree:add_le(G.check, packet(packet:len() - C.trailer_bytes, 4))
  if check then
    word:add(G["check.type"], check):set_generated()
  end
  local known = recall_packet(pinfo, header, check, is_answer)
  for _, remark in ipairs(known.remarks) do
    tree:add_proto_expert_info(Y[remark.what], remark.text)
  end
  if not check then
    tree:add(G.damaged, wrong):set_generated()
    tree:add_proto_expert_info(Y.damaged, wrong)
    return "damaged: " .. wrong
  elseif check == "not ready" then
    tree:add(G.not_ready, true):set_generated()
    tree:add_proto_expert_info(Y.not_ready)
    return "not ready"
  end
  show_header(tree, packet, rows)
  return show_packet(tree, packet, header, known.parameter, is_answer)
end

function chip.dissector(buffer, pinfo, root)
  local mark = buffer:len() > 0 and buffer(0, 1):uint()
  if mark ~= TO_CHIP and mark ~= FROM_CHIP then
    return 0
  end
  local is_answer, length = mark == FROM_CHIP, buffer:len() - 1
  local direction = is_answer and "answer" or "command"
  pinfo.cols.protocol = "ECM-XF"
  local tree = root:add(chip, buffer())
  tree:append_text(", " .. direction)
  tree:add(G.direction, buffer(0, 1), direction)
  local around = C.header_bytes + C.trailer_bytes
  local words = ("%d bytes, as no packet has"):format(length)
  if length >= C.data_min + around and length <= C.data_max + around then
    words = dissect_packet(buffer(1):tvb(), pinfo, tree, is_answer)
  elseif length > 0 then
    tree:add(G.piece, buffer(1))
  end
  pinfo.cols.info = direction .. ": " .. words
  return buffer:len()
end
