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

T.board = {
  aborts = {
    [84082688] = "toggle bit not changed", [84148224] = "SDO protocol timeout",
    [84148225] = "client or server command specifier not valid or unknown", [84148229] = "out of memory",
    [100728832] = "unsupported access to an object", [100728833] = "attempt to read a write-only object",
    [100728834] = "attempt to write a read-only object",
    [100728835] = "sub-index cannot be written, sub-index 0 must be 0 for write access",
    [100728836] = "complete access not supported for objects of variable length",
    [100728837] = "object length exceeds mailbox size", [100728838] = "object mapped to RxPDO, SDO download blocked",
    [100794368] = "object does not exist in the object dictionary",
    [100925505] = "object cannot be mapped into the PDO",
    [100925506] = "number and length of the objects to be mapped would exceed the PDO length",
    [100925507] = "general parameter incompatibility", [100925511] = "general internal incompatibility in the device",
    [101056512] = "access failed due to a hardware error",
    [101122064] = "data type does not match, length of service parameter does not match",
    [101122066] = "data type does not match, length of service parameter too high",
    [101122067] = "data type does not match, length of service parameter too low",
    [101253137] = "sub-index does not exist", [101253168] = "value range of parameter exceeded",
    [101253169] = "value of parameter written too high", [101253170] = "value of parameter written too low",
    [101253171] = "configured module list does not match the detected one",
    [101253174] = "maximum value is less than minimum value", [134217728] = "general error",
    [134217760] = "data cannot be transferred or stored to the application",
    [134217761] = "data cannot be transferred or stored because of local control",
    [134217762] = "data cannot be transferred or stored because of the present device state",
    [134217763] = "object dictionary dynamic generation fails or no object dictionary is present",
    [134217764] = "no data available",
  },
  arguments = {
    auto_shifts = { 65535, 4294901760 }, check_commands = { at = 4, len = 1, mask = 1 }, cycle = { at = 4, len = 4 },
    cycles = {
      [250] = true, [500] = true, [1000] = true, [2000] = true, [4000] = true, [8000] = true, [16000] = true,
      [32000] = true, [64000] = true, [128000] = true, [256000] = true, [512000] = true,
    },
    drive_modes = { [8] = true, [9] = true, [10] = true }, fifo_action = { at = 2, len = 1 },
    fifo_actions = { [1] = "clear", [2] = "threshold" }, fill_responses = { at = 4, len = 1, mask = 16 },
    group = { at = 2, len = 1 }, kinds = { at = 4, len = 4 }, last_group = 4,
    local_outputs = { at = 4, len = 1, mask = 63 }, mode = { at = 4, len = 4 },
    motion = {
      { outputs = { at = 8, len = 2 }, target = { at = 4, len = 4 } },
      { outputs = { at = 14, len = 2 }, target = { at = 10, len = 4 } },
    },
    outputs = { at = 4, len = 2 },
    sdo = {
      index = { at = 6, len = 2 }, size = { at = 3, len = 1 }, sizes = { [1] = true, [2] = true, [4] = true },
      slave = { at = 2, len = 1 }, sub = { at = 4, len = 2 }, value = { at = 8, len = 4 },
    },
    shift = { at = 8, len = 4 }, state = { at = 4, len = 4 }, sync = { at = 8, len = 4 },
    threshold = { at = 4, len = 4 }, torque = { at = 4, len = 2 },
  },
  commands = {
    [0] = { ecm = true, name = "GET_STATUS", sdo = true, slave = true }, [1] = { ecm = true, name = "SET_STATE" },
    [2] = { ecm = true, name = "SET_AXIS" }, [3] = { ecm = true, name = "SET_DC" },
    [4] = { ecm = true, name = "SET_EX" }, [5] = { ecm = true, name = "SET_FIFO" },
    [6] = { name = "DRIVE_MODE", slave = true }, [7] = { name = "SDO_RD", sdo = true },
    [8] = { name = "SDO_WR", sdo = true }, [16] = { axes = true, name = "ALM_CLR", slave = true },
    [17] = { axes = true, name = "SV_ON", slave = true }, [18] = { axes = true, name = "SV_OFF", slave = true },
    [19] = { name = "IO_RD", only = 1, slave = true }, [20] = { name = "IO_WR", only = 1, slave = true },
    [21] = { axes = true, name = "CSP", slave = true }, [22] = { axes = true, name = "CSV", slave = true },
    [23] = { axes = true, name = "CST", only = 0, slave = true },
    [24] = { axes = true, name = "GO_HOME", slave = true }, [25] = { axes = true, name = "ABORT_HOME", slave = true },
    [33] = { ecm = true, name = "LIO_RD" }, [34] = { ecm = true, name = "LIO_WR" },
    [187] = { ecm = true, name = "SW_RESET" },
  },
  crc = { at = 3, init = 90, poly = 7 }, cyclic = { code = 191, name = "CYCLIC" },
  error_codes = {
    { 0, 0, "no error" }, { 1, 4095, "see the drive's manual" }, { 4096, 4096, "generic error" },
    { 4097, 8191, "see the drive's manual" }, { 8192, 8463, "current" },
    { 8464, 8464, "short circuit or earth leakage at the input" }, { 8465, 8479, "current" },
    { 8480, 8480, "short circuit or earth leakage at the input" }, { 8481, 8495, "current" },
    { 8496, 8496, "short circuit or earth leakage at the input" }, { 8497, 8720, "current" },
    { 8721, 8724, "overcurrent inside the device" }, { 8725, 8735, "current" },
    { 8736, 8736, "continuous overcurrent inside the device" }, { 8737, 8751, "current" },
    { 8752, 8752, "short circuit or earth leakage inside the device" }, { 8753, 8767, "current" },
    { 8768, 8768, "short circuit or earth leakage inside the device" }, { 8769, 8783, "current" },
    { 8784, 8784, "short circuit or earth leakage inside the device" }, { 8785, 8975, "current" },
    { 8976, 8979, "continuous overcurrent at the output" }, { 8980, 8991, "current" },
    { 8992, 8992, "short circuit or earth leakage on the motor's side" }, { 8993, 9007, "current" },
    { 9008, 9008, "short circuit or earth leakage on the motor's side" }, { 9009, 9023, "current" },
    { 9024, 9024, "short circuit or earth leakage on the motor's side" }, { 9025, 9039, "current" },
    { 9040, 9040, "load too high for too long (I2t)" }, { 9041, 12287, "current" }, { 12288, 12559, "voltage" },
    { 12560, 12563, "mains voltage too high" }, { 12564, 12575, "voltage" },
    { 12576, 12579, "mains voltage too low" }, { 12580, 12591, "voltage" }, { 12592, 12596, "mains phase missing" },
    { 12597, 12815, "voltage" }, { 12816, 12818, "DC link voltage too high" }, { 12819, 12831, "voltage" },
    { 12832, 12834, "DC link voltage too low" }, { 12835, 16383, "voltage" }, { 16384, 16655, "temperature" },
    { 16656, 16656, "temperature too high" }, { 16657, 16671, "temperature" },
    { 16672, 16672, "temperature too low" }, { 16673, 16911, "temperature" },
    { 16912, 16912, "temperature too high" }, { 16913, 16927, "temperature" },
    { 16928, 16928, "temperature too low" }, { 16929, 17167, "temperature" },
    { 17168, 17168, "temperature too high" }, { 17169, 17183, "temperature" },
    { 17184, 17184, "temperature too low" }, { 17185, 17423, "temperature" },
    { 17424, 17424, "temperature too high" }, { 17425, 17439, "temperature" },
    { 17440, 17440, "temperature too low" }, { 17441, 20479, "temperature" },
    { 20480, 21807, "hardware of the device" }, { 21808, 21808, "non-volatile memory of the device" },
    { 21809, 24575, "hardware of the device" }, { 24576, 25375, "software of the device" },
    { 25376, 25376, "a parameter is wrong" }, { 25377, 28671, "software of the device" },
    { 28672, 28943, "additional modules (motor, brake, sensor)" }, { 28944, 28947, "brake chopper" },
    { 28948, 28960, "additional modules (motor, brake, sensor)" }, { 28961, 28961, "motor blocked" },
    { 28962, 28962, "motor or its commutation" }, { 28963, 29439, "additional modules (motor, brake, sensor)" },
    { 29440, 29695, "sensor (encoder, resolver, tacho)" },
    { 29696, 29951, "additional modules (motor, brake, sensor)" }, { 29952, 30207, "communication" },
    { 30208, 32767, "additional modules (motor, brake, sensor)" }, { 32768, 33023, "monitoring" },
    { 33024, 33279, "communication" }, { 33280, 33552, "monitoring of the motion" },
    { 33553, 33553, "torque too high" }, { 33554, 33791, "monitoring of the motion" },
    { 33792, 33792, "velocity controller" }, { 33793, 34047, "monitoring of the motion" },
    { 34048, 34048, "position controller" }, { 34049, 34320, "monitoring of the motion" },
    { 34321, 34321, "following error" }, { 34322, 34322, "position limit" },
    { 34323, 36863, "monitoring of the motion" }, { 36864, 37119, "external error" },
    { 37120, 65279, "see the drive's manual" }, { 65280, 65535, "of the maker's own, see the drive's manual" },
  },
  fifo_entries = 160,
  head = {
    data1 = { at = 4, len = 4 }, data2 = { at = 8, len = 4 }, data3 = { at = 12, len = 4 }, id = { at = 0, len = 1 },
    index = { at = 1, len = 1 }, parm = { at = 2, len = 2 },
  },
  kinds = { [0] = "drive", [1] = "io", [2] = "hsp", [3] = "step", [15] = "none" },
  malformed = {
    cycle = "cycle time %d us is not 250 us * 2^n up to 1 s",
    fifo_action = "FIFO action %d is neither 1 clear nor 2 threshold", group = "group %d is above 4",
    kind = "slave %d has kind 0x%X: none of 0 drive, 1 IO, 2 HSP, 3 STEP, F none",
    mode = "mode %d is none of 8 CSP, 9 CSV, 10 CST", sdo_size = "object size %d is none of 1, 2, 4 bytes",
    sdo_slave = "the board has no slave %d", state = "state %d is none of 1 Init, 2 PreOP, 4 SafeOP, 8 OP",
    sub = "sub-index %d is above 255", zero_threshold = "FIFO threshold 0 could never be reached",
  },
  modes = { [6] = "HM", [8] = "CSP", [9] = "CSV", [10] = "CST" },
  responses = {
    drive = {
      error_code = { at = 10, len = 2 }, position = { at = 4, len = 4 }, statusword = { at = 2, len = 2 },
      torque = { at = 8, len = 2 },
    },
    hsp = {
      axes = {
        { inputs = { at = 8, len = 2 }, position = { at = 4, len = 4 } },
        { inputs = { at = 14, len = 2 }, position = { at = 10, len = 4 } },
      },
      statusword = { at = 2, len = 2 },
    },
    io = { bits = { at = 4, len = 2 } },
    master = {
      crc_errors = { at = 1, len = 1 }, fifo_free = { at = 8, len = 2 }, full_count = { at = 10, len = 2 },
      result = { at = 4, len = 4 }, state = { at = 2, len = 1 },
    },
    sdo = { aborted = { at = 3, len = 1, mask = 128 } },
  },
  sizes = { { bytes = 12, frame = 504, slots = 42 }, { bytes = 16, frame = 512, slots = 32 } },
  states = {
    [0] = { failed = false, text = "network initialising" }, [1] = { failed = false, state = "Init", text = "Init" },
    [2] = { failed = false, state = "PreOP", text = "PreOP" },
    [4] = { failed = false, state = "SafeOP", text = "SafeOP" }, [8] = { failed = false, state = "OP", text = "OP" },
    [16] = {
      failed = true, text = "no slave found",
      why = "the board finds no slave, or a slave failed; look at the network cable and at the slaves' power",
    },
    [17] = {
      failed = true, state = "Init", text = "Init (a slave failed)",
      why = "a slave did not go to PreOP; look at the slaves' power and at the cable, then SET_STATE again",
    },
    [18] = {
      failed = true, state = "PreOP", text = "PreOP (a slave failed)",
      why = "a slave did not go on from PreOP; most often it is declared as something else than it is, or not at all, which counts as IO: declare every slave in PreOP with SET_AXIS (0 drive, 1 IO, 2 HSP, 3 STEP, F none) and its mode with DRIVE_MODE, then SET_STATE again",
    },
    [20] = {
      failed = true, state = "SafeOP", text = "SafeOP (a slave failed)",
      why = "a slave fell out of the network or refused the next state; look at its power, its cable and its own display, then send SET_STATE to bring it back",
    },
    [24] = {
      failed = true, state = "OP", text = "OP (a slave failed)",
      why = "a slave has left OP: by its watchdog, if this machine was late, or as its cable or its power is gone; look at its own display, then send SET_STATE to bring it back",
    },
  },
  statusword = {
    bits = {
      { "fault", 8 }, { "voltage_enabled", 16 }, { "quick_stop", 32 }, { "warning", 128 }, { "remote", 512 },
      { "target_reached", 1024 }, { "internal_limit", 2048 }, { "bit12", 4096 }, { "bit13", 8192 },
    },
    faults = { "Fault reaction active", "Fault" }, mask = 111,
    states = {
      [0] = "Not ready to switch on", [7] = "Quick stop active", [8] = "Fault", [15] = "Fault reaction active",
      [32] = "Not ready to switch on", [33] = "Ready to switch on", [35] = "Switched on", [39] = "Operation enabled",
      [40] = "Fault", [47] = "Fault reaction active", [64] = "Switch on disabled", [96] = "Switch on disabled",
    },
  },
  unknown_state = "unknown 0x%02X (no slave found, or a slave failed)", usb = { product = 1503, vendor = 5824 },
}

T.chip = {
  always_fixed = 23,
  answer_header = {
    { at = 4, kind = "number", len = 1, name = "crc_errors" },
    { at = 5, kind = "number", len = 1, name = "wkc_errors" }, { at = 6, kind = "number", len = 1, name = "tx_fifo" },
    { at = 7, kind = "number", len = 1, name = "rx_fifo" }, { at = 8, kind = "state", len = 1, name = "state" },
    {
      at = 9,
      bits = {
        { "link_pin", 1 }, { "phy_link", 2 }, { "state", 4 }, { "non_immediate", 8 }, { "spi", 16 }, { "fifo", 32 },
        { "crc", 64 }, { "command", 128 },
      },
      kind = "hex", len = 1, name = "errors",
    },
    {
      at = 10,
      bits = {
        { "dc_stable", 4 }, { "port_ready", 8 }, { "pdo_configured", 16 }, { "nop", 32 }, { "fifo_on", 64 },
        { "busy", 128 },
      },
      kind = "hex", len = 1, name = "status",
    },
    { at = 11, kind = "number", len = 1, name = "index" }, { at = 12, kind = "code", len = 1, name = "code" },
    { at = 13, kind = "number", len = 1, name = "ret" }, { at = 14, kind = "number", len = 2, name = "len" },
    {
      at = 16,
      bits = {
        { "ethercat", 2147483648 }, { "encoder", 536870912 }, { "rx_fifo_low", 33554432 },
        { "tx_fifo_high", 16777216 }, { "crc", 8388608 }, { "working_counter", 4194304 },
      },
      kind = "hex", len = 4, name = "interrupts",
    },
    { at = 20, kind = "hex", len = 2, name = "gpio_interrupts" },
    { at = 22, kind = "hex", len = 2, name = "gpio_inputs" },
  },
  check = { crc32 = 3, fixed = 0, mask = 3 },
  command_header = {
    { at = 4, kind = "bytes", len = 4, name = "info" },
    {
      at = 8, bits = { { "gpio_outputs_valid", 32768 }, { "master_shift", 4096 }, { "lrw", 2048 } }, kind = "hex",
      len = 2, name = "reserve",
    },
    {
      at = 10,
      bits = {
        { "bit_0", 1 }, { "update_state", 2 }, { "clear_non_immediate", 8 }, { "clear_spi", 16 },
        { "clear_fifo", 32 }, { "clear_crc", 64 }, { "clear_command", 128 },
      },
      kind = "hex", len = 1, name = "control",
    },
    { at = 11, kind = "number", len = 1, name = "index" }, { at = 12, kind = "code", len = 1, name = "code" },
    { at = 13, kind = "number", len = 1, name = "parameter" }, { at = 14, kind = "number", len = 2, name = "len" },
    {
      at = 16,
      bits = {
        { "ethercat", 2147483648 }, { "encoder", 536870912 }, { "rx_fifo_low", 33554432 },
        { "tx_fifo_high", 16777216 }, { "crc", 8388608 }, { "working_counter", 4194304 },
      },
      kind = "hex", len = 4, name = "interrupt_clear",
    },
    { at = 20, kind = "hex", len = 2, name = "gpio_interrupt_clear" },
    { at = 22, kind = "hex", len = 2, name = "gpio_outputs" },
  },
  commands = {
    [0] = "ECM_CMD_INFO_UPDATE_OP", [1] = "ECM_CMD_ECAT_INIT_OP", [2] = "ECM_CMD_ECAT_RECONFIG_OP",
    [3] = "ECM_CMD_ECAT_INIT_DC_OP", [4] = "ECM_CMD_ECAT_PDO_WC_GET", [5] = "ECM_CMD_ECAT_PDO_DATA_FIFO_OP",
    [6] = "ECM_CMD_ECAT_PDO_DATA_OP", [7] = "ECM_CMD_ECAT_PDO_CONFIG_SET", [8] = "ECM_CMD_ECAT_PDO_CONFIG_REQ",
    [9] = "ECM_CMD_ECAT_PDO_CONFIG_GET", [10] = "ECM_CMD_ECAT_SDO_REQ", [11] = "ECM_CMD_ECAT_SDO_GET",
    [12] = "ECM_CMD_ECAT_STATE_SET", [13] = "ECM_CMD_ECAT_STATE_GET", [15] = "ECM_CMD_ECAT_SLV_INFO_GET",
    [16] = "ECM_CMD_ECAT_SLV_CNT_GET", [18] = "ECM_CMD_FIFO_ENABLE", [19] = "ECM_CMD_FIFO_PACK_SIZE_GET",
    [20] = "ECM_CMD_SPI_PACK_SIZE_GET", [23] = "ECM_CMD_SPI_RECONFIG_OP", [24] = "ECM_CMD_CRC_ERR_CNT_CLR",
    [25] = "ECM_CMD_CRC_TYPE_SET", [26] = "ECM_CMD_402_CONFIG_SET", [27] = "ECM_CMD_402_STATE_SET",
    [28] = "ECM_CMD_402_STATE_GET", [29] = "ECM_CMD_402_CTL_SET", [30] = "ECM_CMD_402_CTL_GET",
    [31] = "ECM_GPIO_CONFIG_SET", [32] = "ECM_GPIO_FUNC_OP", [33] = "ECM_QEI_FUNC_OP", [34] = "ECM_DAC_FUNC_OP",
    [35] = "ECM_ADC_FUNC_OP", [38] = "ECM_EEPROM_REQ", [39] = "ECM_EEPROM_GET", [41] = "ECM_CMD_ECAT_STATE_CHECK",
    [50] = "ECM_CMD_ECAT_DCSYNC", [51] = "ECM_CMD_FIFO_CLR_OP", [52] = "ECM_CMD_FIFO_SET_TX_CNT",
    [53] = "ECM_CMD_FIFO_GET_TX_CNT", [54] = "ECM_CMD_FIFO_SET_RX_CNT", [55] = "ECM_CMD_FIFO_GET_RX_CNT",
    [56] = "ECM_CMD_FW_VERSION_GET", [57] = "ECM_CMD_ECAT_STATE_UPDATE", [58] = "ECM_CMD_ECAT_INT_SET_ENABLE",
    [59] = "ECM_CMD_ECAT_INT_GET_ENABLE", [66] = "ECM_CMD_FIFO_INIT", [69] = "ECM_CMD_ECAT_SDO_ABORTCODE_GET",
    [70] = "ECM_CMD_ECAT_SET_FIFO_TH", [71] = "ECM_CMD_ECAT_CONFIG_SM", [72] = "ECM_CMD_ECAT_CONFIG_FMMU",
    [73] = "ECM_CMD_ECAT_CONFIG_MAP", [74] = "ECM_CMD_402_GET_STATUSWORD", [75] = "ECM_CMD_ASYNCCMD_RESET",
    [81] = "ECM_CMD_MDIO", [82] = "ECM_CMD_DIRECT_ASSIGN", [83] = "ECM_CMD_COE_EMERGENCY",
    [127] = "ECM_CMD_WARM_RESET", [130] = "ECM_CMD_ECAT_WKC_CONTI_ERR_CNT_GET",
    [131] = "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_GET", [132] = "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_SET",
    [137] = "ECM_CMD_RAW_ECAT_FUNC_REQ", [138] = "ECM_CMD_RAW_ECAT_FUNC_GET", [139] = "ECM_CMD_FOE_FUNC_REQ",
    [140] = "ECM_CMD_FOE_FUNC_GET", [142] = "ECM_CMD_ENABLE_LRW", [143] = "ECM_CMD_RECV_MAILBOX",
    [144] = "ECM_CMD_MBX_STAT",
  },
  data_max = 1408, data_min = 32, emergency = 83, end_word = 1448564825, errors = 248, fifo_error = 32,
  fixed_check = 305419896,
  functions = {
    {
      code = 0, key = "info_update", name = "ECM_CMD_INFO_UPDATE_OP", what = "asks for a new header and nothing else",
    },
    {
      code = 1, key = "ecat_init", name = "ECM_CMD_ECAT_INIT_OP",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "special_slaves", names = { [0] = "no", [48] = "yes" },
          place = "parameter",
        },
        {
          at = 0, bits = { { "master_shift", 4096 }, { "lrw", 2048 } }, bytes = 2, kind = "hex", name = "reserve",
          place = "reserve",
        },
        { at = 1, bytes = 1, kind = "number", name = "fifo", names = { [0] = "on", [129] = "off" }, place = "data" },
        { at = 2, bytes = 2, kind = "hex", name = "assign_activate", place = "data" },
        { at = 4, bytes = 4, kind = "number", name = "sync0_ns", place = "data" },
        { at = 8, bytes = 4, kind = "number", name = "sync1_ns", place = "data" },
        { at = 12, bytes = 4, kind = "signed", name = "shift_ns", place = "data" },
      },
      what = "initialises the network",
    },
    {
      code = 2, key = "reconfig", name = "ECM_CMD_ECAT_RECONFIG_OP",
      what = "lays out the chip's memory anew after a change of process data",
    },
    { code = 3, key = "init_dc", name = "ECM_CMD_ECAT_INIT_DC_OP", what = "initialises the distributed clocks" },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "number", name = "value", place = "data" } } } }, code = 4,
      key = "pdo_working_counter_get", name = "ECM_CMD_ECAT_PDO_WC_GET",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "which",
          names = { [1] = "Inputs", [2] = "Outputs", [3] = "Counter" }, place = "parameter",
        },
      },
      what = "reads the working counter, or how many slaves count in it",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bits = { { "write", 1 }, { "read", 2 }, { "valid", 4 }, { "failed", 128 } }, bytes = 1,
              kind = "hex", name = "done", place = "ret",
            },
            { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" },
          },
        },
      },
      code = 5, key = "pdo_data_fifo", name = "ECM_CMD_ECAT_PDO_DATA_FIFO_OP",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "count", place = "parameter" },
        {
          at = 0, bits = { { "write", 1 }, { "read", 2 }, { "valid", 4 }, { "failed", 128 } }, bytes = 1,
          kind = "hex", name = "operation", place = "info",
        },
        { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" },
      },
      what = "moves process data through the FIFOs",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bits = { { "write", 1 }, { "read", 2 }, { "valid", 4 }, { "failed", 128 } }, bytes = 1,
              kind = "hex", name = "done", place = "ret",
            },
            { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" },
          },
        },
      },
      code = 6, key = "pdo_data", name = "ECM_CMD_ECAT_PDO_DATA_OP",
      request = {
        {
          at = 0, bits = { { "write", 1 }, { "read", 2 }, { "valid", 4 }, { "failed", 128 } }, bytes = 1,
          kind = "hex", name = "operation", place = "info",
        },
        { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" },
      },
      what = "moves process data past the FIFOs",
    },
    {
      code = 7, key = "pdo_config_set", name = "ECM_CMD_ECAT_PDO_CONFIG_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
        { at = 1, bytes = 1, kind = "number", name = "count", place = "data" },
        {
          at = 2, bytes = 2, kind = "number", name = "assignment", names = { [7186] = "Rx", [7187] = "Tx" },
          place = "data",
        },
        { at = 4, bytes = 2, kind = "hex", name = "pdo1", place = "data" },
        { at = 16, bytes = 32, count_at = 10, kind = "objects", name = "objects1", place = "data" },
        { at = 6, bytes = 2, kind = "hex", name = "pdo2", place = "data" },
        { at = 48, bytes = 32, count_at = 12, kind = "objects", name = "objects2", place = "data" },
        { at = 8, bytes = 2, kind = "hex", name = "pdo3", place = "data" },
        { at = 80, bytes = 32, count_at = 14, kind = "objects", name = "objects3", place = "data" },
      },
      what = "sets the PDOs of a slave",
    },
    {
      code = 8, key = "pdo_config_request", name = "ECM_CMD_ECAT_PDO_CONFIG_REQ",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
        {
          at = 2, bytes = 2, kind = "number", name = "assignment", names = { [7186] = "Rx", [7187] = "Tx" },
          place = "data",
        },
      },
      what = "has the PDOs of a slave read, for PDO_CONFIG_GET",
    },
    {
      answers = {
        {
          fields = {
            { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
            { at = 1, bytes = 1, kind = "number", name = "count", place = "data" },
            {
              at = 2, bytes = 2, kind = "number", name = "assignment", names = { [7186] = "Rx", [7187] = "Tx" },
              place = "data",
            },
            { at = 4, bytes = 2, kind = "hex", name = "pdo1", place = "data" },
            { at = 16, bytes = 32, count_at = 10, kind = "objects", name = "objects1", place = "data" },
            { at = 6, bytes = 2, kind = "hex", name = "pdo2", place = "data" },
            { at = 48, bytes = 32, count_at = 12, kind = "objects", name = "objects2", place = "data" },
            { at = 8, bytes = 2, kind = "hex", name = "pdo3", place = "data" },
            { at = 80, bytes = 32, count_at = 14, kind = "objects", name = "objects3", place = "data" },
          },
          len = 112,
        },
        {
          fields = {
            { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
            { at = 1, bytes = 1, kind = "number", name = "count", place = "data" },
            {
              at = 2, bytes = 2, kind = "number", name = "assignment", names = { [7186] = "Rx", [7187] = "Tx" },
              place = "data",
            },
            { at = 4, bytes = 2, kind = "hex", name = "pdo1", place = "data" },
            { at = 20, bytes = 32, count_at = 12, kind = "objects", name = "objects1", place = "data" },
            { at = 6, bytes = 2, kind = "hex", name = "pdo2", place = "data" },
            { at = 52, bytes = 32, count_at = 14, kind = "objects", name = "objects2", place = "data" },
            { at = 8, bytes = 2, kind = "hex", name = "pdo3", place = "data" },
            { at = 84, bytes = 32, count_at = 16, kind = "objects", name = "objects3", place = "data" },
            { at = 10, bytes = 2, kind = "hex", name = "pdo4", place = "data" },
            { at = 116, bytes = 32, count_at = 18, kind = "objects", name = "objects4", place = "data" },
          },
          len = 148,
        },
      },
      code = 9, key = "pdo_config_get", name = "ECM_CMD_ECAT_PDO_CONFIG_GET",
      what = "gives what PDO_CONFIG_REQ has read",
    },
    {
      code = 10, key = "sdo_request", name = "ECM_CMD_ECAT_SDO_REQ",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation", names = { [0] = "Write", [1] = "Read" },
          place = "data",
        },
        { at = 1, bytes = 1, kind = "number", name = "slave", place = "data" },
        { at = 2, bytes = 2, kind = "hex", name = "index", place = "data" },
        { at = 4, bytes = 1, kind = "number", name = "sub", place = "data" },
        {
          at = 5, bytes = 1, kind = "number", name = "complete", names = { [0] = "Off", [1] = "On" }, place = "data",
        },
        { at = 6, bytes = 2, counts = "data", kind = "number", name = "bytes", place = "data" },
        { at = 8, bytes = 4, kind = "number", name = "timeout_us", place = "data" },
        { at = 12, bytes = 0, kind = "bytes", name = "data", place = "data" },
      },
      what = "reads an object of a slave, for SDO_GET, or writes one",
    },
    {
      answers = { { fields = { { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" } } } }, code = 11,
      key = "sdo_get", name = "ECM_CMD_ECAT_SDO_GET", what = "gives the object that SDO_REQ has read",
    },
    {
      code = 12, key = "state_set", name = "ECM_CMD_ECAT_STATE_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slaves", names = { [255] = "all" }, place = "parameter" },
        {
          at = 0, bytes = 1, kind = "number", name = "state",
          names = { [1] = "Init", [2] = "PreOp", [3] = "Boot", [4] = "SafeOp", [8] = "Op" }, place = "info",
        },
      },
      what = "brings slaves to a state",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bytes = 1, kind = "number", mask = 15, name = "state",
              names = { [1] = "Init", [2] = "PreOp", [3] = "Boot", [4] = "SafeOp", [8] = "Op" }, place = "ret",
              shift = 0,
            },
            {
              at = 0, bytes = 1, kind = "number", mask = 16, name = "error", names = { [0] = "Off", [1] = "On" },
              place = "ret", shift = 4,
            },
          },
        },
      },
      code = 13, key = "state_get", name = "ECM_CMD_ECAT_STATE_GET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slaves", names = { [255] = "all" }, place = "parameter" },
      },
      what = "gives the state of slaves from the chip's memory",
    },
    {
      answers = { { fields = { { at = 0, bytes = 0, kind = "number_or_text", name = "value", place = "data" } } } },
      code = 15, key = "slave_info_get", name = "ECM_CMD_ECAT_SLV_INFO_GET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "parameter" },
        {
          at = 0, bytes = 1, kind = "number", name = "item",
          names = {
            [0] = "Vendor", [1] = "Product", [2] = "Revision", [3] = "Name", [4] = "StationAddress", [5] = "Alias",
            [6] = "State", [7] = "AlStatus", [8] = "OutputBytes", [9] = "InputBytes", [10] = "HasDc",
            [11] = "DcCycle", [12] = "DcShift", [13] = "DcActive",
          },
          place = "info",
        },
      },
      what = "gives an item about a slave",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "number", name = "count", place = "ret" } } } }, code = 16,
      key = "slave_count_get", name = "ECM_CMD_ECAT_SLV_CNT_GET", what = "gives the number of slaves",
    },
    {
      code = 18, key = "fifo_enable", name = "ECM_CMD_FIFO_ENABLE",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "on", names = { [0] = "Off", [1] = "On" }, place = "parameter" },
      },
      what = "switches the RxFIFO's cyclic output on or off",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "number", name = "bytes", place = "data" } } } },
      code = 19, key = "fifo_pack_size_get", name = "ECM_CMD_FIFO_PACK_SIZE_GET",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "fifo", names = { [0] = "Rx", [1] = "Tx" }, place = "parameter",
        },
      },
      what = "gives the bytes of one PDO",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "number", name = "bytes", place = "data" } } } },
      code = 20, key = "spi_pack_size_get", name = "ECM_CMD_SPI_PACK_SIZE_GET",
      what = "gives n, the size of the data segment",
    },
    {
      code = 23, key = "spi_reconfig", name = "ECM_CMD_SPI_RECONFIG_OP",
      request = { { at = 0, bytes = 2, kind = "number", name = "size", place = "len" } }, what = "sets n",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "number", name = "returned", place = "ret" } } } },
      code = 24, key = "crc_error_count_clear", name = "ECM_CMD_CRC_ERR_CNT_CLR",
      what = "clears the count of wrong check words",
    },
    {
      code = 25, key = "crc_type_set", name = "ECM_CMD_CRC_TYPE_SET",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "kind", names = { [0] = "fixed", [3] = "crc32" },
          place = "parameter",
        },
      },
      what = "chooses the check word",
    },
    {
      code = 26, key = "helper_config_set", name = "ECM_CMD_402_CONFIG_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" },
        { at = 0, bytes = 1, kind = "number", name = "controlword_offset", place = "info" },
        { at = 1, bytes = 1, kind = "number", name = "statusword_offset", place = "info" },
        {
          at = 2, bits = { { "reset_once", 8 }, { "on", 16 }, { "reset_always", 128 } }, bytes = 1, kind = "hex",
          name = "control", place = "info",
        },
        { at = 3, bytes = 1, kind = "number", name = "slave", place = "info" },
      },
      what = "tells the CiA 402 helper where an axis has its words",
    },
    {
      code = 27, key = "helper_state_set", name = "ECM_CMD_402_STATE_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" },
        { at = 0, bytes = 1, kind = "drive_state", name = "state", place = "info" },
      },
      what = "leads an axis to a state",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "drive_state", name = "state", place = "ret" } } } },
      code = 28, key = "helper_state_get", name = "ECM_CMD_402_STATE_GET",
      request = { { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" } },
      what = "gives the state of an axis",
    },
    {
      code = 29, key = "helper_control_set", name = "ECM_CMD_402_CTL_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" },
        {
          at = 0, bits = { { "reset_once", 8 }, { "on", 16 }, { "reset_always", 128 } }, bytes = 1, kind = "hex",
          name = "control", place = "info",
        },
        { at = 1, bytes = 1, kind = "hex", name = "key", place = "info" },
        { at = 2, bytes = 1, kind = "number", name = "motors", place = "info" },
        { at = 3, bytes = 1, kind = "number", name = "slave", place = "info" },
      },
      what = "changes what the helper does with an axis",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bits = { { "reset_once", 8 }, { "on", 16 }, { "reset_always", 128 } }, bytes = 1, kind = "hex",
              name = "control", place = "ret",
            },
          },
        },
      },
      code = 30, key = "helper_control_get", name = "ECM_CMD_402_CTL_GET",
      request = { { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" } },
      what = "gives what the helper does with an axis",
    },
    {
      code = 31, key = "gpio_set_mode", name = "ECM_GpioSetMode", parameter = 0,
      request = {
        { at = 0, bytes = 2, kind = "hex", name = "pins", place = "info" },
        {
          at = 2, bytes = 1, kind = "number", name = "mode",
          names = { [0] = "Input", [1] = "Output", [2] = "OpenDrain", [3] = "QuasiBidirectional" }, place = "info",
        },
        {
          at = 3, bytes = 1, kind = "number", name = "pull", names = { [0] = "None", [1] = "Up", [2] = "Down" },
          place = "info",
        },
      },
      what = "makes GPIO 0 to 15 inputs or outputs",
    },
    {
      code = 31, key = "gpio_int_enable", name = "ECM_GpioIntEnable", parameter = 1,
      request = {
        { at = 0, bytes = 1, kind = "number", name = "channel", place = "info" },
        {
          at = 1, bytes = 1, kind = "number", name = "trigger",
          names = { [0] = "Off", [1] = "Both", [2] = "Falling", [3] = "Rising", [4] = "Driver4", [5] = "Driver5" },
          place = "info",
        },
      },
      what = "chooses the edges at which a GPIO raises an interrupt",
    },
    {
      code = 31, key = "gpio_enable_debounce", name = "ECM_GpioEnableDebounce", parameter = 2,
      request = {
        { at = 0, bytes = 2, kind = "hex", name = "pins", place = "info" },
        { at = 2, bytes = 1, kind = "number", name = "on", names = { [0] = "Off", [1] = "On" }, place = "info" },
      },
      what = "debounces inputs among GPIO 0 to 15",
    },
    {
      code = 31, key = "gpio_set_debounce_clock", name = "ECM_GpioSetDebounceClock", parameter = 3,
      request = {
        { at = 0, bytes = 1, kind = "number", mask = 15, name = "exponent", place = "info", shift = 0 },
        {
          at = 0, bytes = 1, kind = "number", mask = 240, name = "source", names = { [0] = "Mhz192", [1] = "Khz10" },
          place = "info", shift = 4,
        },
      },
      what = "chooses how often debounced inputs are sampled",
    },
    {
      code = 31, key = "gpio_int_clear", name = "ECM_GpioIntClear", parameter = 4,
      request = { { at = 0, bytes = 2, kind = "hex", name = "pins", place = "info" } },
      what = "clears interrupt flags of GPIO 0 to 15",
    },
    {
      code = 31, key = "gpio_int_clear_ext", name = "ECM_GpioIntClear", parameter = 6,
      request = { { at = 0, bytes = 3, kind = "hex", name = "pins", place = "info" } },
      what = "clears interrupt flags of GPIO 0 to 19",
    },
    {
      code = 31, key = "gpio_set_mode_ext", name = "ECM_GpioSetMode", parameter = 8,
      request = {
        { at = 0, bytes = 1, kind = "hex", name = "pins", place = "info" },
        {
          at = 2, bytes = 1, kind = "number", name = "mode",
          names = { [0] = "Input", [1] = "Output", [2] = "OpenDrain", [3] = "QuasiBidirectional" }, place = "info",
        },
        {
          at = 3, bytes = 1, kind = "number", name = "pull", names = { [0] = "None", [1] = "Up", [2] = "Down" },
          place = "info",
        },
      },
      what = "makes GPIO 16 to 19 inputs or outputs: bit k of pins is GPIO 16 + k",
    },
    {
      code = 31, key = "gpio_enable_debounce_ext", name = "ECM_GpioEnableDebounce", parameter = 9,
      request = {
        { at = 0, bytes = 1, kind = "hex", name = "pins", place = "info" },
        { at = 2, bytes = 1, kind = "number", name = "on", names = { [0] = "Off", [1] = "On" }, place = "info" },
      },
      what = "debounces inputs among GPIO 16 to 19: bit k of pins is GPIO 16 + k",
    },
    {
      code = 32, key = "gpio_set_value", name = "ECM_GpioSetValue", parameter = 0,
      request = { { at = 0, bytes = 2, kind = "hex", name = "values", place = "info" } },
      what = "sets the outputs of GPIO 0 to 15",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "hex", name = "values", place = "data" } } } }, code = 32,
      key = "gpio_get_value", name = "ECM_GpioGetValue", parameter = 1, what = "gives the inputs of GPIO 0 to 15",
    },
    {
      code = 32, key = "gpio_ext_set_value", name = "ECM_GpioExtSetValue", parameter = 2,
      request = { { at = 0, bytes = 3, kind = "hex", name = "values", place = "info" } },
      what = "sets the outputs of GPIO 0 to 19",
    },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "hex", name = "values", place = "data" } } } }, code = 32,
      key = "gpio_ext_get_value", name = "ECM_GpioExtGetValue", parameter = 3,
      what = "gives the inputs of GPIO 0 to 19",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "hex", name = "flags", place = "data" } } } }, code = 32,
      key = "gpio_get_int_flag", name = "ECM_GpioGetIntFlag", parameter = 5,
      what = "gives the interrupt flags of GPIO 0 to 15",
    },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "hex", name = "flags", place = "data" } } } }, code = 32,
      key = "gpio_ext_get_int_flag", name = "ECM_GpioExtGetIntFlag", parameter = 7,
      what = "gives the interrupt flags of GPIO 0 to 19",
    },
    {
      code = 33, key = "enc_open", name = "ECM_EncOpen", parameter = 4,
      request = {
        {
          at = 0, bytes = 4, kind = "number", name = "mode",
          names = { [0] = "X4Free", [256] = "X2Free", [512] = "X4Compare", [768] = "X2Compare" }, place = "data",
        },
      },
      what = "opens the encoder",
    },
    { code = 33, key = "enc_start", name = "ECM_EncStart", parameter = 5, what = "starts the encoder" },
    { code = 33, key = "enc_stop", name = "ECM_EncStop", parameter = 6, what = "stops the encoder" },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "number", name = "count", place = "data" } } } },
      code = 33, key = "enc_get_count", name = "ECM_EncGetCount", parameter = 21, what = "gives the encoder's count",
    },
    {
      code = 34, key = "dac_start_conv", name = "ECM_DacStartConv", parameter = 0, what = "puts out the DAC's value",
    },
    {
      code = 34, key = "dac_set_data", name = "ECM_DacSetData", parameter = 11,
      request = { { at = 0, bytes = 4, kind = "number", name = "value", place = "data" } },
      what = "sets the DAC's value, 0 to 4095 for 0 V to 3.3 V",
    },
    {
      code = 34, key = "dac_open", name = "ECM_DacOpen", parameter = 20,
      request = {
        {
          at = 0, bytes = 4, kind = "number", name = "trigger",
          names = {
            [0] = "SetData", [16] = "StartConv", [48] = "PinLow", [4144] = "PinHigh", [8240] = "PinRising",
            [12336] = "PinFalling",
          },
          place = "data",
        },
      },
      what = "opens the DAC",
    },
    { code = 34, key = "dac_close", name = "ECM_DacClose", parameter = 21, what = "closes the DAC" },
    {
      code = 34, key = "dac_set_delay_time", name = "ECM_DacSetDelayTime", parameter = 22,
      request = { { at = 0, bytes = 4, kind = "number", name = "delay", place = "data" } },
      what = "sets how long a conversion of the DAC takes, in 1/96 us",
    },
    {
      code = 35, key = "adc_start_conv", name = "ECM_AdcStartConv", parameter = 12,
      request = { { at = 0, bytes = 4, kind = "hex", name = "number", place = "data" } },
      what = "starts a conversion of the ADC",
    },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "number", name = "value", place = "data" } } } },
      code = 35, key = "adc_get_conv_data", name = "ECM_AdcGetConvData", parameter = 15,
      request = { { at = 0, bytes = 4, kind = "hex", name = "number", place = "data" } },
      what = "gives the ADC's value, 0 to 4095 for 0 V to 3.3 V",
    },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "number", name = "valid", place = "data" } } } },
      code = 35, key = "adc_get_data_valid_flag", name = "ECM_AdcGetDataValidFlag", parameter = 17,
      request = { { at = 0, bytes = 4, kind = "hex", name = "number", place = "data" } },
      what = "tells whether a conversion of the ADC is done",
    },
    {
      code = 35, key = "adc_open", name = "ECM_AdcOpen", parameter = 40,
      request = {
        {
          at = 0, bytes = 4, kind = "number", name = "mode", names = { [0] = "SingleEnded", [256] = "Differential" },
          place = "data",
        },
      },
      what = "opens the ADC",
    },
    { code = 35, key = "adc_close", name = "ECM_AdcClose", parameter = 41, what = "closes the ADC" },
    {
      code = 35, key = "adc_config_sample_module", name = "ECM_AdcConfigSampleModule", parameter = 42,
      request = { { at = 4, bytes = 4, kind = "number", name = "trigger", place = "data" } },
      what = "has conversions of the ADC started by software",
    },
    {
      code = 38, key = "eeprom_request", name = "ECM_EEPROM_REQ",
      request = {
        {
          at = 0, bytes = 2, kind = "number", name = "operation", names = { [0] = "Read", [1] = "Write" },
          place = "data",
        },
        { at = 2, bytes = 2, kind = "number", name = "slave", place = "data" },
        { at = 4, bytes = 2, kind = "hex", name = "position", place = "data" },
        { at = 6, bytes = 2, kind = "hex", name = "value", place = "data" },
        { at = 8, bytes = 4, kind = "number", name = "timeout_us", place = "data" },
      },
      what = "reads a slave's EEPROM, for EEPROM_GET, or writes it",
    },
    {
      answers = {
        {
          fields = {
            { at = 0, bytes = 1, kind = "number", name = "error", place = "ret" },
            { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" },
          },
        },
      },
      code = 39, key = "eeprom_get", name = "ECM_EEPROM_GET", what = "gives what EEPROM_REQ has read",
    },
    {
      code = 41, key = "state_check", name = "ECM_CMD_ECAT_STATE_CHECK",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slaves", names = { [255] = "all" }, place = "parameter" },
        {
          at = 0, bytes = 1, kind = "number", name = "state",
          names = { [1] = "Init", [2] = "PreOp", [3] = "Boot", [4] = "SafeOp", [8] = "Op" }, place = "info",
        },
      },
      what = "brings slaves to a state and reads it back",
    },
    {
      code = 50, key = "dc_sync", name = "ECM_CMD_ECAT_DCSYNC",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slaves", names = { [255] = "all" }, place = "data" },
        { at = 2, bytes = 2, kind = "hex", name = "assign_activate", place = "data" },
        { at = 4, bytes = 4, kind = "number", name = "sync0_ns", place = "data" },
        { at = 8, bytes = 4, kind = "number", name = "sync1_ns", place = "data" },
        { at = 12, bytes = 4, kind = "signed", name = "shift_ns", place = "data" },
      },
      what = "sets other times of the distributed clocks for one slave",
    },
    {
      code = 51, key = "fifo_clear", name = "ECM_CMD_FIFO_CLR_OP",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "fifos", names = { [0] = "Both", [1] = "Tx", [2] = "Rx" },
          place = "parameter",
        },
      },
      what = "empties FIFOs",
    },
    {
      code = 52, key = "fifo_set_tx_count", name = "ECM_CMD_FIFO_SET_TX_CNT",
      request = { { at = 0, bytes = 1, kind = "number", name = "entries", place = "parameter" } },
      what = "sets the entries of the TxFIFO, which hold from FIFO_INIT on",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "number", name = "entries", place = "ret" } } } },
      code = 53, key = "fifo_get_tx_count", name = "ECM_CMD_FIFO_GET_TX_CNT",
      what = "gives the entries of the TxFIFO",
    },
    {
      code = 54, key = "fifo_set_rx_count", name = "ECM_CMD_FIFO_SET_RX_CNT",
      request = { { at = 0, bytes = 1, kind = "number", name = "entries", place = "parameter" } },
      what = "sets the entries of the RxFIFO, which hold from FIFO_INIT on",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "number", name = "entries", place = "ret" } } } },
      code = 55, key = "fifo_get_rx_count", name = "ECM_CMD_FIFO_GET_RX_CNT",
      what = "gives the entries of the RxFIFO",
    },
    {
      answers = {
        {
          fields = {
            { at = 0, bytes = 1, kind = "hex", name = "version", place = "ret" },
            { at = 0, bytes = 2, kind = "hex", name = "extended", place = "data" },
            { at = 3, bytes = 1, kind = "number", name = "series", place = "data" },
            { at = 4, bytes = 16, kind = "bytes", name = "identification", place = "data" },
          },
        },
      },
      code = 56, key = "firmware_version_get", name = "ECM_CMD_FW_VERSION_GET",
      what = "gives version and series of the chip",
    },
    {
      code = 57, key = "state_update", name = "ECM_CMD_ECAT_STATE_UPDATE",
      what = "reads the states of the slaves into the chip's memory",
    },
    {
      code = 58, key = "interrupt_set_enable", name = "ECM_CMD_ECAT_INT_SET_ENABLE",
      request = {
        {
          at = 0, bits = { { "int1_high", 1 }, { "int0_high", 2 } }, bytes = 1, kind = "hex", name = "polarity",
          place = "parameter",
        },
        {
          at = 0,
          bits = {
            { "ethercat", 2147483648 }, { "encoder", 536870912 }, { "rx_fifo_low", 33554432 },
            { "tx_fifo_high", 16777216 }, { "crc", 8388608 }, { "working_counter", 4194304 },
          },
          bytes = 4, kind = "hex", name = "sources", place = "data",
        },
        { at = 4, bytes = 1, kind = "hex", name = "gpio", place = "data" },
        {
          at = 5,
          bits = {
            { "gpio_8", 1 }, { "gpio_9", 2 }, { "gpio_10", 4 }, { "gpio_11", 8 }, { "encoder_index", 16 },
            { "encoder_compare", 32 }, { "encoder_overflow", 64 },
          },
          bytes = 1, kind = "hex", name = "peripherals", place = "data",
        },
      },
      what = "chooses what raises INT1, and the polarity of INT0 and INT1",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bits = { { "int1_high", 1 }, { "int0_high", 2 } }, bytes = 1, kind = "hex", name = "polarity",
              place = "ret",
            },
            {
              at = 0,
              bits = {
                { "ethercat", 2147483648 }, { "encoder", 536870912 }, { "rx_fifo_low", 33554432 },
                { "tx_fifo_high", 16777216 }, { "crc", 8388608 }, { "working_counter", 4194304 },
              },
              bytes = 4, kind = "hex", name = "sources", place = "data",
            },
            { at = 4, bytes = 1, kind = "hex", name = "gpio", place = "data" },
            {
              at = 5,
              bits = {
                { "gpio_8", 1 }, { "gpio_9", 2 }, { "gpio_10", 4 }, { "gpio_11", 8 }, { "encoder_index", 16 },
                { "encoder_compare", 32 }, { "encoder_overflow", 64 },
              },
              bytes = 1, kind = "hex", name = "peripherals", place = "data",
            },
          },
        },
      },
      code = 59, key = "interrupt_get_enable", name = "ECM_CMD_ECAT_INT_GET_ENABLE",
      what = "gives what INT_SET_ENABLE has set",
    },
    {
      code = 66, key = "fifo_init", name = "ECM_CMD_FIFO_INIT",
      what = "builds the FIFOs from their entries and the sizes of the PDOs",
    },
    {
      answers = { { fields = { { at = 0, bytes = 4, kind = "abort", name = "abort", place = "data" } } } }, code = 69,
      key = "sdo_abort_code_get", name = "ECM_CMD_ECAT_SDO_ABORTCODE_GET",
      what = "gives the abort code of the last SDO transfer",
    },
    {
      code = 70, key = "fifo_threshold_set", name = "ECM_CMD_ECAT_SET_FIFO_TH",
      request = {
        {
          at = 0, bits = { { "tx_high", 1 }, { "rx_low", 2 } }, bytes = 1, kind = "hex", name = "on",
          place = "parameter",
        },
        { at = 0, bytes = 1, kind = "number", name = "tx_high", place = "info" },
        { at = 1, bytes = 1, kind = "number", name = "rx_low", place = "info" },
      },
      what = "sets the limits at which FIFOs raise an interrupt",
    },
    {
      code = 71, key = "config_sync_manager", name = "ECM_CMD_ECAT_CONFIG_SM",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
        { at = 1, bytes = 1, kind = "number", name = "number", place = "data" },
        { at = 2, bytes = 2, kind = "hex", name = "start", place = "data" },
        { at = 4, bytes = 2, kind = "number", name = "length", place = "data" },
        { at = 6, bytes = 1, kind = "hex", name = "control", place = "data" },
        { at = 7, bytes = 1, kind = "hex", name = "activate", place = "data" },
      },
      what = "sets a sync manager of a slave",
    },
    {
      code = 72, key = "config_fmmu", name = "ECM_CMD_ECAT_CONFIG_FMMU",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
        { at = 1, bytes = 1, kind = "number", name = "fmmu0", place = "data" },
        { at = 2, bytes = 1, kind = "number", name = "fmmu1", place = "data" },
        { at = 3, bytes = 1, kind = "number", name = "fmmu2", place = "data" },
        { at = 4, bytes = 1, kind = "number", name = "fmmu3", place = "data" },
      },
      what = "sets the functions of a slave's FMMUs, without effect",
    },
    {
      code = 73, key = "config_map", name = "ECM_CMD_ECAT_CONFIG_MAP",
      what = "as RECONFIG, for slaves that fall back to their default process data with that",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "hex", name = "statusword", place = "data" } } } },
      code = 74, key = "helper_statusword_get", name = "ECM_CMD_402_GET_STATUSWORD",
      request = { { at = 0, bytes = 1, kind = "number", name = "motor", place = "parameter" } },
      what = "gives the statusword of an axis",
    },
    {
      code = 75, key = "async_reset", name = "ECM_CMD_ASYNCCMD_RESET",
      request = {
        {
          at = 0, bits = { { "clear_busy", 1 }, { "skip_port_wait", 2 }, { "give_up", 4 } }, bytes = 1, kind = "hex",
          name = "action", place = "parameter",
        },
      },
      what = "ends what keeps the chip busy",
    },
    {
      answers = { { fields = { { at = 0, bytes = 2, kind = "hex", name = "value", place = "data" } } } }, code = 81,
      key = "mdio", name = "ECM_CMD_MDIO",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation", names = { [0] = "Write", [1] = "Read" },
          place = "parameter",
        },
        { at = 0, bytes = 1, kind = "number", name = "register", place = "info" },
        { at = 1, bytes = 1, kind = "number", name = "phy", place = "info" },
        { at = 2, bytes = 2, kind = "hex", name = "value", place = "info" },
      },
      what = "reads or writes a register of a PHY",
    },
    {
      code = 82, key = "direct_assign", name = "ECM_CMD_DIRECT_ASSIGN",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation", names = { [0] = "Switch", [1] = "Length" },
          place = "parameter",
        },
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "info" },
        { at = 1, bytes = 1, kind = "number", name = "on", names = { [0] = "Off", [1] = "On" }, place = "info" },
        {
          at = 1, bytes = 1, kind = "number", name = "direction", names = { [0] = "Output", [1] = "Input" },
          place = "info",
        },
        { at = 2, bytes = 2, kind = "number", name = "bytes", place = "info" },
      },
      what = "assigns the length of a slave's process data by hand",
    },
    {
      answers = {
        {
          every = 12,
          fields = {
            { at = 0, bytes = 1, kind = "number", name = "number", names = { [255] = "none" }, place = "data" },
            { at = 1, bytes = 1, kind = "number", name = "slave", place = "data" },
            { at = 2, bytes = 2, kind = "number", name = "running_number", place = "data" },
            { at = 4, bytes = 2, kind = "hex", name = "code", place = "data" },
            { at = 6, bytes = 1, kind = "hex", name = "register", place = "data" },
            { at = 7, bytes = 5, kind = "bytes", name = "data", place = "data" },
          },
        },
      },
      code = 83, key = "coe_emergency", name = "ECM_CMD_COE_EMERGENCY",
      request = { { at = 0, bytes = 1, kind = "number", name = "count", place = "parameter" } },
      what = "lists the newest emergencies of slaves",
    },
    {
      code = 127, key = "warm_reset", name = "ECM_CMD_WARM_RESET", what = "resets the chip: all is as after power-on",
    },
    {
      answers = { { fields = { { at = 0, bytes = 1, kind = "number", name = "count", place = "ret" } } } },
      code = 130, key = "wkc_error_count_get", name = "ECM_CMD_ECAT_WKC_CONTI_ERR_CNT_GET",
      what = "gives how many working counters in a row were wrong",
    },
    {
      answers = {
        {
          fields = {
            { at = 0, bytes = 1, kind = "number", name = "limit", names = { [255] = "none" }, place = "ret" },
          },
        },
      },
      code = 131, key = "wkc_error_max_get", name = "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_GET",
      what = "gives how many of them are allowed",
    },
    {
      code = 132, key = "wkc_error_max_set", name = "ECM_CMD_ECAT_WKC_CONTI_ERR_MAX_SET",
      request = {
        { at = 0, bytes = 1, kind = "number", name = "limit", names = { [255] = "none" }, place = "parameter" },
      },
      what = "sets how many of them are allowed",
    },
    {
      code = 137, key = "raw_request", name = "ECM_CMD_RAW_ECAT_FUNC_REQ",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation",
          names = {
            [1] = "Aprd", [2] = "Apwr", [4] = "Fprd", [5] = "Fpwr", [7] = "Brd", [8] = "Bwr", [10] = "Lrd",
            [11] = "Lwr", [12] = "Lrw", [13] = "Armw", [14] = "Frmw",
          },
          place = "data",
        },
        { at = 2, bytes = 2, counts = "data", kind = "number", name = "bytes", place = "data" },
        { at = 4, bytes = 2, kind = "hex", name = "adp", place = "data" },
        { at = 6, bytes = 2, kind = "hex", name = "ado", place = "data" },
        { at = 8, bytes = 4, kind = "hex", name = "logical", place = "data" },
        { at = 12, bytes = 4, kind = "signed", name = "timeout_us", place = "data" },
        { at = 20, bytes = 0, kind = "bytes", name = "data", place = "data" },
      },
      what = "sends an EtherCAT datagram, whose answer is for RAW_ECAT_FUNC_GET",
    },
    {
      answers = {
        {
          fields = {
            {
              at = 0, bytes = 1, kind = "number", name = "operation",
              names = {
                [1] = "Aprd", [2] = "Apwr", [4] = "Fprd", [5] = "Fpwr", [7] = "Brd", [8] = "Bwr", [10] = "Lrd",
                [11] = "Lwr", [12] = "Lrw", [13] = "Armw", [14] = "Frmw",
              },
              place = "data",
            },
            { at = 4, bytes = 2, kind = "hex", name = "adp", place = "data" },
            { at = 6, bytes = 2, kind = "hex", name = "ado", place = "data" },
            { at = 8, bytes = 4, kind = "hex", name = "logical", place = "data" },
            { at = 12, bytes = 4, kind = "signed", name = "timeout_us", place = "data" },
            { at = 16, bytes = 4, kind = "signed", name = "working_counter", place = "data" },
            { at = 20, bytes = 0, kind = "bytes", name = "data", place = "data" },
          },
        },
      },
      code = 138, key = "raw_get", name = "ECM_CMD_RAW_ECAT_FUNC_GET", what = "gives what came back of the datagram",
    },
    {
      code = 139, key = "foe_request", name = "ECM_CMD_FOE_FUNC_REQ",
      request = {
        {
          at = 2, bytes = 1, kind = "number", name = "operation",
          names = { [1] = "Upload", [2] = "Download", [3] = "ReadFlash", [4] = "WriteFlash" }, place = "data",
        },
        { at = 0, bytes = 1, kind = "number", name = "slave", place = "data" },
        { at = 4, bytes = 4, kind = "hex", name = "password", place = "data" },
        { at = 8, bytes = 4, counts = "data", kind = "number", name = "bytes", place = "data" },
        { at = 12, bytes = 4, kind = "number", name = "timeout_us", place = "data" },
        { at = 16, bytes = 4, kind = "hex", name = "start", place = "data" },
        { at = 20, bytes = 0, kind = "text", name = "name", place = "data" },
        { at = 20, bytes = 0, kind = "bytes", name = "data", place = "data" },
      },
      what = "moves a file between a slave and the flash memory, or reads or writes that",
    },
    {
      answers = { { fields = { { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" } } } }, code = 140,
      key = "foe_get", name = "ECM_CMD_FOE_FUNC_GET",
      what = "gives the part of the flash memory that FOE_FUNC_REQ has read",
    },
    {
      code = 142, key = "enable_lrw", name = "ECM_CMD_ENABLE_LRW",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "lrw", names = { [0] = "Off", [1] = "On" }, place = "parameter",
        },
      },
      what = "chooses LRW, or LRD and LWR, for process data",
    },
    {
      answers = { { fields = { { at = 0, bytes = 0, kind = "bytes", name = "data", place = "data" } } } }, code = 143,
      key = "receive_mailbox", name = "ECM_CMD_RECV_MAILBOX",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation", names = { [0] = "Request", [1] = "Read" },
          place = "parameter",
        },
        { at = 0, bytes = 2, kind = "number", name = "slave", place = "info" },
        { at = 0, bytes = 2, kind = "number", name = "start", place = "info" },
        { at = 2, bytes = 2, kind = "number", name = "length", place = "info" },
      },
      what = "fetches a slave's mailbox, or gives a part of it",
    },
    {
      answers = { { fields = { { at = 0, bytes = 0, kind = "bytes", name = "slaves", place = "data" } } } },
      code = 144, key = "mailbox_status", name = "ECM_CMD_MBX_STAT",
      request = {
        {
          at = 0, bytes = 1, kind = "number", name = "operation",
          names = { [0] = "ReadFlags", [1] = "SetPolling", [2] = "ReadPolling" }, place = "parameter",
        },
        { at = 0, bytes = 0, kind = "bytes", name = "slaves", place = "data" },
      },
      what = "tells which mailboxes are full, or which are polled, or sets that",
    },
  },
  header_bytes = 24, nop = 32, not_ready = 2271560481, start_word = 2711790500, state_error = 16,
  states = { [1] = "Init", [2] = "PreOp", [3] = "Boot", [4] = "SafeOp", [8] = "Op" }, trailer_bytes = 8,
}

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
