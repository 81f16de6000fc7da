-- Numbers in bytes. Lua 5.2 has a library for bits, Lua 5.3 and later have operators, which 5.2 cannot parse.
local bits = bit32 or load([[return {
  band = function(a, b) return a & b end,
  bxor = function(a, b) return a ~ b end,
  rshift = function(a, n) return a >> n end,
}]])()

-- The part of a slot at a place.
local function part(slot, place)
  return slot(place.at, place.len)
end

-- The unsigned number at a place of a slot, of its bits if the place has a mask.
local function number(slot, place)
  local value = part(slot, place):le_uint()
  return place.mask and bits.band(value, place.mask) or value
end

-- The signed number at a place of a slot.
local function signed(slot, place)
  return part(slot, place):le_int()
end

-- The meaning of an error code (object 0x603F).
local function error_name(code)
  for _, range in ipairs(T.board.error_codes) do
    if code <= range[2] then
      return range[3]
    end
  end
end

-- A CRC-8 as bytes are added, from the most significant bit on.
local crc8 = { table = {} }
for byte = 0, 255 do
  local crc = byte
  for _ = 1, 8 do
    crc = crc >= 0x80 and bits.bxor(crc * 2 - 0x100, T.board.crc.poly) or crc * 2
  end
  crc8.table[byte] = crc
end

-- The CRC-8 of a frame, once for each length in ascending order. The byte of the CRC itself counts as 0.
function crc8.of(bytes, lengths)
  local crc, found, begin = T.board.crc.init, {}, 1
  for n, length in ipairs(lengths) do
    for at = begin, length do
      local byte = at == T.board.crc.at + 1 and 0 or bytes:byte(at)
      crc = crc8.table[bits.bxor(crc, byte)]
    end
    found[n], begin = crc, length + 1
  end
  return found
end

-- The CRC-32 of zlib.
local crc32 = { table = {} }
for byte = 0, 255 do
  local crc = byte
  for _ = 1, 8 do
    local half = bits.rshift(crc, 1)
    crc = crc % 2 == 1 and bits.bxor(half, 0xEDB88320) or half
  end
  crc32.table[byte] = crc
end

-- The CRC-32 of the first `length` bytes, once for each length in ascending order.
function crc32.of(bytes, lengths)
  local crc, found, begin = 0xFFFFFFFF, {}, 1
  for n, length in ipairs(lengths) do
    for at = begin, length do
      crc = bits.bxor(bits.rshift(crc, 8), crc32.table[bits.band(bits.bxor(crc, bytes:byte(at)), 0xFF)])
    end
    found[n], begin = bits.bxor(crc, 0xFFFFFFFF), length + 1
  end
  return found
end
