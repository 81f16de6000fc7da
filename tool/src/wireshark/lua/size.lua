-- The size of slots, which frames do not state: by the length, the CRC or the slots of a frame, else by those of the
-- frames before it.
local NARROW, WIDE = T.board.sizes[1], T.board.sizes[2]

-- The size for which alone a test holds.
local function only(narrow, wide)
  if narrow ~= wide then
    return narrow and NARROW or WIDE
  end
end

-- Whether a slot is all 0, or holds a command of this role that asks for something, or the answer to one.
local function is_slot(bytes, at, size, role)
  local id = bytes:byte(at + HEAD.id.at)
  if id == 0 then
    return not bytes:sub(at, at + size.bytes - 1):find("[^\0]")
  end
  local command = command_of(id)
  if not command or not command[role] then
    return false
  end
  local slave = bytes:byte(at + A.sdo.slave.at)
  return role ~= "sdo" or slave >= 1 and slave <= size.slots - 2
end

-- Whether the slots of a frame have this size.
local function fits(bytes, size)
  local id = bytes:byte(1)
  if id ~= T.board.cyclic.code and not command_of(id) then
    return false
  end
  for n = 1, size.slots - 1 do
    if not is_slot(bytes, n * size.bytes + 1, size, n == size.slots - 1 and "sdo" or "slave") then
      return false
    end
  end
  return true
end

-- The size that a frame shows, or nil.
local function own_size(bytes)
  if #bytes < WIDE.frame then
    return NARROW
  end
  local crc, by_crc = bytes:byte(T.board.crc.at + 1), nil
  if crc ~= 0 then
    local expected = crc8.of(bytes, { NARROW.frame, WIDE.frame })
    by_crc = only(expected[1] == crc, expected[2] == crc)
  end
  return by_crc or only(fits(bytes, NARROW), fits(bytes, WIDE))
end

-- The size of a frame's slots, by the frames of its board so far.
local function size_of(board, bytes)
  for _, size in ipairs(T.board.sizes) do
    if ecmsk.prefs.slot_bytes == size.bytes then
      return size
    end
  end
  local own = own_size(bytes)
  if own then
    board.votes[own] = (board.votes[own] or 0) + 1
    return own
  end
  return (board.votes[WIDE] or 0) > (board.votes[NARROW] or 0) and WIDE or NARROW
end
