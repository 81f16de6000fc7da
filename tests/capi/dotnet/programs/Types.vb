' Each member of the vendor's class, used in ways that only its exact type allows, with Option Strict On: that it compiles is half of the
' test. Types.cs is the same in C#.
Option Strict On
Option Explicit On
Option Infer On
Imports System
Imports System.Collections.Generic
#If SLOTS_OF_16_BYTES Then
Imports NEXTWUSB_dotNET_16B
#Else
Imports NEXTWUSB_dotNET_12B
#End If

Module Types
    ' Constants of their own types, as of a program that renames them.
    Const SLOTS As Integer = NEXTWUSB.DEF_MA_MAX
    Const CRC_SWITCH As UShort = NEXTWUSB.SDO_EX
    Const MODE As UInteger = NEXTWUSB.CSP_MODE
    Const EMPTY As Short = NEXTWUSB.None

    Enum Command As UShort
        TurnOn = NEXTWUSB.SV_ON
        TurnOff = NEXTWUSB.SV_OFF
    End Enum

    Enum Modes As UInteger
        Position = NEXTWUSB.CSP_MODE
        Velocity = NEXTWUSB.CSV_MODE
        Torque = NEXTWUSB.CST_MODE
    End Enum

    Enum Kind As Short
        Drive = NEXTWUSB.DRIVE
        Step_ = NEXTWUSB.STEP
    End Enum

    Sub Told(Of T)(name As String, value As T)
        Console.WriteLine("{0} {1} {2}", name, GetType(T).Name, value)
    End Sub

    Sub Constants()
        Told("DEF_MA_MAX", NEXTWUSB.DEF_MA_MAX)
        Told("STATE_INIT", NEXTWUSB.STATE_INIT)
        Told("STATE_PRE_OP", NEXTWUSB.STATE_PRE_OP)
        Told("STATE_SAFE_OP", NEXTWUSB.STATE_SAFE_OP)
        Told("STATE_OPERATIONAL", NEXTWUSB.STATE_OPERATIONAL)
        Told("GET_STATUS", NEXTWUSB.GET_STATUS)
        Told("SET_STATE", NEXTWUSB.SET_STATE)
        Told("SET_AXIS", NEXTWUSB.SET_AXIS)
        Told("SET_DC", NEXTWUSB.SET_DC)
        Told("SDO_EX", NEXTWUSB.SDO_EX)
        Told("SDO_FIFO", NEXTWUSB.SDO_FIFO)
        Told("DRIVE_MODE", NEXTWUSB.DRIVE_MODE)
        Told("SDO_RD", NEXTWUSB.SDO_RD)
        Told("SDO_WR", NEXTWUSB.SDO_WR)
        Told("ALM_CLR", NEXTWUSB.ALM_CLR)
        Told("SV_ON", NEXTWUSB.SV_ON)
        Told("SV_OFF", NEXTWUSB.SV_OFF)
        Told("IO_RD", NEXTWUSB.IO_RD)
        Told("IO_WR", NEXTWUSB.IO_WR)
        Told("CSP", NEXTWUSB.CSP)
        Told("CSV", NEXTWUSB.CSV)
        Told("CST", NEXTWUSB.CST)
        Told("GO_HOME", NEXTWUSB.GO_HOME)
        Told("ABORT_HOME", NEXTWUSB.ABORT_HOME)
        Told("LIO_RD", NEXTWUSB.LIO_RD)
        Told("LIO_WR", NEXTWUSB.LIO_WR)
        Told("SW_RESET", NEXTWUSB.SW_RESET)
        Told("HOMING_MODE", NEXTWUSB.HOMING_MODE)
        Told("CSP_MODE", NEXTWUSB.CSP_MODE)
        Told("CSV_MODE", NEXTWUSB.CSV_MODE)
        Told("CST_MODE", NEXTWUSB.CST_MODE)
        Told("FREERUN", NEXTWUSB.FREERUN)
        Told("DCSYNC", NEXTWUSB.DCSYNC)
        Told("DRIVE", NEXTWUSB.DRIVE)
        Told("IO", NEXTWUSB.IO)
        Told("HSP", NEXTWUSB.HSP)
        Told("STEP", NEXTWUSB.STEP)
        Told("None", NEXTWUSB.None)
    End Sub

    Sub PutAt(axis As Integer, command As UShort, data As UInteger)
        Put(NEXTWUSB.cmdData(axis), command, data)
    End Sub

    Sub Put(ByRef slot As NEXTWUSB.transData, Optional command As UShort = NEXTWUSB.GET_STATUS,
            Optional data As UInteger = NEXTWUSB.FREERUN)
        slot.CMD = command
        slot.Data1 = data
    End Sub

    Function Named(command As UShort) As String
        Select Case command
            Case NEXTWUSB.SV_ON
                Return "SV_ON"
            Case NEXTWUSB.SV_OFF
                Return "SV_OFF"
            Case NEXTWUSB.DRIVE_MODE
                Return "DRIVE_MODE"
            Case Else
                Return "another"
        End Select
    End Function

    Function Named(mode As UInteger) As String
        Select Case mode
            Case NEXTWUSB.CSP_MODE
                Return "CSP"
            Case NEXTWUSB.CSV_MODE
                Return "CSV"
            Case Else
                Return "another"
        End Select
    End Function

    Function Named(kind As Short) As String
        Select Case kind
            Case NEXTWUSB.DRIVE
                Return "drive"
            Case NEXTWUSB.IO
                Return "io"
            Case Else
                Return "another"
        End Select
    End Function

    Sub Uses(isOn As Boolean, velocity As Boolean)
        NEXTWUSB.cmdData(1).CMD = If(isOn, NEXTWUSB.SV_ON, NEXTWUSB.SV_OFF)
        NEXTWUSB.cmdData(1).Data1 = If(velocity, NEXTWUSB.CSV_MODE, NEXTWUSB.CSP_MODE)
        NEXTWUSB.cmdData(1).Data2 = NEXTWUSB.DCSYNC
        Dim mode = NEXTWUSB.CSP_MODE
        PutAt(2, NEXTWUSB.DRIVE_MODE, mode)
        PutAt(3, Command.TurnOff, Modes.Torque)
        Put(NEXTWUSB.cmdData(4))
        Dim kind As Short = If(isOn = velocity, NEXTWUSB.IO, NEXTWUSB.DRIVE)
        Dim kinds As Short() = {NEXTWUSB.DRIVE, NEXTWUSB.IO, NEXTWUSB.HSP, NEXTWUSB.STEP, EMPTY}
        Dim nibbles As UInteger = 0
        For Each one As Short In kinds
            nibbles = nibbles << 4 Or CUInt(one)
        Next
        NEXTWUSB.cmdData(0).CMD = NEXTWUSB.SET_STATE
        NEXTWUSB.cmdData(0).Data1 = NEXTWUSB.STATE_PRE_OP
        Dim names As New Dictionary(Of UShort, String) From {{NEXTWUSB.SV_ON, "on"}, {NEXTWUSB.SV_OFF, "off"}}
        Dim all As New List(Of UInteger) From {NEXTWUSB.CSP_MODE, NEXTWUSB.CSV_MODE, Types.MODE}
        Console.WriteLine("{0} {1} {2} {3} {4} {5}", Named(NEXTWUSB.cmdData(1).CMD), Named(NEXTWUSB.cmdData(1).Data1),
            Named(NEXTWUSB.cmdData(2).CMD), Named(kind), names(NEXTWUSB.cmdData(1).CMD), all.IndexOf(mode))
        Console.WriteLine("{0:X} {1} {2} {3} {4}", nibbles, SLOTS = NEXTWUSB.cmdData.Length, CRC_SWITCH,
            Types.Kind.Step_.ToString().Trim("_"c), NEXTWUSB.cmdData(3).Data1)
    End Sub

    ' Neither array is ReadOnly.
    Sub Swap(ByRef one As NEXTWUSB.transData(), ByRef other As NEXTWUSB.transData())
        Dim kept As NEXTWUSB.transData() = one
        one = other
        other = kept
    End Sub

    Sub Calls()
        Dim open As Func(Of Boolean) = AddressOf NEXTWUSB.OpenECMUSB
        Dim write As Func(Of Boolean) = AddressOf NEXTWUSB.ECMUSBWrite
        Dim read As Func(Of Boolean) = AddressOf NEXTWUSB.ECMUSBRead
        Dim check As Func(Of Boolean) = AddressOf NEXTWUSB.checkCRCValue
        Dim close As Action = AddressOf NEXTWUSB.CloseECMUSB
        Dim clear As Action = AddressOf NEXTWUSB.ClearCmdData
        Dim crc As Func(Of Byte(), Byte) = AddressOf CRC8.CRC
        Dim part As Func(Of Byte(), Integer, Integer, Byte) = AddressOf CRC8.CRC
        Console.WriteLine("CRC {0:X2} {1:X2} {2}", crc(New Byte() {1, 2, 3}), part(New Byte() {0, 1, 2, 3}, 1, 3), check())
        Console.WriteLine("open {0}", open())
        clear()
        NEXTWUSB.cmdData(0).CMD = NEXTWUSB.GET_STATUS
        Dim written As Boolean = write()
        Dim isRead As Boolean = read()
        ' .NET Core has no Console.WriteLine of four values.
        Console.WriteLine(String.Format("write {0}, read {1}, state {2}, CRC {3}", written, isRead,
            NEXTWUSB.respData(0).Parm And &HFFUS, check()))
        Swap(NEXTWUSB.cmdData, NEXTWUSB.respData)
        Console.WriteLine("swapped {0}", NEXTWUSB.cmdData(0).Parm And &HFFUS)
        Swap(NEXTWUSB.cmdData, NEXTWUSB.respData)
        close()
        Console.WriteLine("closed: write {0}, read {1}", write(), read())
    End Sub

#If SLOTS_OF_16_BYTES Then
    Sub Channels()
        Dim slot As New NEXTWUSB.transData With {.CMD = NEXTWUSB.CSP, .Parm = 7}
        slot.Data1 = &H11223344UI
        slot.Data2 = &HAABB5566UI
        slot.Data3 = &H7788CCDDUI
        Dim channels As NEXTWUSB.CSCHSP = CType(slot, NEXTWUSB.CSCHSP)
        Console.WriteLine("{0:X} {1} {2:X} {3:X} {4:X} {5:X}", channels.CMD, channels.Parm, channels.Pulse1, channels.InOut1,
            channels.Pulse2, channels.InOut2)
        channels.Pulse2 += 1UI
        NEXTWUSB.cmdData(1) = CType(channels, NEXTWUSB.transData)
        slot = NEXTWUSB.cmdData(1)
        Console.WriteLine("{0:X} {1} {2:X} {3:X} {4:X}", slot.CMD, slot.Parm, slot.Data1, slot.Data2, slot.Data3)
    End Sub
#End If

    Sub Main()
        Constants()
        Uses(True, False)
        Uses(False, True)
#If SLOTS_OF_16_BYTES Then
        Channels()
#End If
        Calls()
    End Sub
End Module
