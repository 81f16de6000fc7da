-- The protocol of a chip, and its fields.
local chip = Proto("ecmsk_xf", "ECM-XF")
local C, G = T.chip, {}

-- The type of a number of this many bytes; `prefix` is "uint" or "int".
local function number_type(prefix, bytes)
  return prefix .. 8 * math.min(bytes, 4)
end

local function add_bits(abbreviation, bytes, rows)
  for _, row in ipairs(rows or {}) do
    local name = abbreviation .. "." .. row[1]
    G[name] = ProtoField.bool("ecmsk_xf." .. name, row[1]:gsub("_", " "), 8 * bytes, nil, row[2])
  end
end

for _, row in ipairs({ { "direction", "Direction", "string" }, { "command", "Command", "string" },
  { "what", "Purpose", "string" }, { "check", "Check word", "uint32", base.HEX }, { "check.type", "Check", "string" },
  { "damaged", "Damaged", "string" }, { "not_ready", "Not ready", "bool" }, { "nop", "Without a result", "bool" },
  { "piece", "Bytes as no packet has", "bytes" }, { "data", "Data", "bytes" }, { "repeated", "Part", "none" } }) do
  G[row[1]] = ProtoField[row[3]]("ecmsk_xf." .. row[1], row[2], row[4])
end

-- The fields of the headers. Both have an index, a code and a length.
for _, header in ipairs({ C.command_header, C.answer_header }) do
  for _, row in ipairs(header) do
    local label, name = row.name:gsub("_", " "), "ecmsk_xf." .. row.name
    if G[row.name] then
      label = nil
    elseif row.kind == "bytes" then
      G[row.name] = ProtoField.bytes(name, label)
    elseif row.kind == "hex" or row.kind == "state" then
      G[row.name] = ProtoField[number_type("uint", row.len)](name, label, base.HEX)
      add_bits(row.name, row.len, row.bits)
    else
      local names = row.kind == "code" and C.commands or nil
      G[row.name] = ProtoField[number_type("uint", row.len)](name, label, base.DEC, names)
    end
  end
end

-- What the fields of requests and answers are in Wireshark.
local DRIVE_STATES = T.board.statusword.states
local kinds = {
  number = function(name, field)
    return ProtoField[number_type("uint", field.bytes)](name, field.name, base.DEC, field.names)
  end,
  signed = function(name, field) return ProtoField[number_type("int", field.bytes)](name, field.name, base.DEC) end,
  hex = function(name, field) return ProtoField[number_type("uint", field.bytes)](name, field.name, base.HEX) end,
  drive_state = function(name, field)
    return ProtoField[number_type("uint", field.bytes)](name, field.name, base.HEX, DRIVE_STATES)
  end,
  abort = function(name, field) return ProtoField.uint32(name, field.name, base.HEX, T.board.aborts) end,
  bytes = function(name, field) return ProtoField.bytes(name, field.name) end,
  text = function(name, field) return ProtoField.string(name, field.name) end,
  number_or_text = function(name, field) return ProtoField.string(name, field.name) end,
  objects = function(name, field) return ProtoField.uint32(name, field.name, base.HEX) end,
}

-- Makes the fields of a list, each behind `prefix`. The forms of an answer share those of one name.
local function make_fields(prefix, list)
  for _, field in ipairs(list or {}) do
    field.key = prefix .. field.name
    if not G[field.key] then
      G[field.key] = kinds[field.kind]("ecmsk_xf." .. field.key, field)
      add_bits(field.key, field.bytes, field.bits)
    end
  end
end

-- The functions by their code and, with those of the codes that have several, their parameter.
local functions = {}
for _, row in ipairs(C.functions) do
  make_fields(row.key .. ".", row.request)
  for _, form in ipairs(row.answers or {}) do
    make_fields(row.key .. ".answer.", form.fields)
  end
  functions[row.code .. (row.parameter and ":" .. row.parameter or "")] = row
end
chip.fields = G

local Y = {
  damaged = ProtoExpert.new("ecmsk_xf.damaged_packet", "The packet is damaged", expert.group.CHECKSUM,
    expert.severity.ERROR),
  not_ready = ProtoExpert.new("ecmsk_xf.lost_command", "The chip was not ready: the command of this exchange is lost",
    expert.group.SEQUENCE, expert.severity.NOTE),
  error = ProtoExpert.new("ecmsk_xf.error", "The chip has an error", expert.group.RESPONSE_CODE, expert.severity.WARN),
  fifo_full = ProtoExpert.new("ecmsk_xf.fifo_full", "A write found the RxFIFO full", expert.group.SEQUENCE,
    expert.severity.ERROR),
  slave_lost = ProtoExpert.new("ecmsk_xf.slave_lost", "A slave is lost", expert.group.SEQUENCE, expert.severity.ERROR),
  emergency = ProtoExpert.new("ecmsk_xf.emergency", "A slave has sent an emergency", expert.group.RESPONSE_CODE,
    expert.severity.NOTE),
}
chip.experts = Y
