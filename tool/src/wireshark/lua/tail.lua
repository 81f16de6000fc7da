-- Where the two protocols are found. A recording, and a capture that began after the board was plugged in, have no ids:
-- there any interrupt transfer that is as long as a frame is one. Where the interface of a device is known, so are its
-- ids.
local CLASS_UNKNOWN = 0xFFFF
local class_of = Field.new("usb.bInterfaceClass")
DissectorTable.get("usb.product"):add(T.board.usb.vendor * 0x10000 + T.board.usb.product, ecmsk)
ecmsk:register_heuristic("usb.interrupt", function(buffer, pinfo, root)
  local class = class_of()
  if class and class.value ~= CLASS_UNKNOWN or not frame_in(buffer) then
    return false
  end
  return ecmsk.dissector(buffer, pinfo, root) > 0
end)
DissectorTable.get("wtap_encap"):add((wtap_encaps or wtap).USER15, chip)
