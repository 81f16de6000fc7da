//! Finds the interfaces with a default route in the route tables of the Linux kernel.

/// The interfaces with a default route in the kernel's table `/proc/net/route`. A route is a default route if its
/// destination (2nd column) and its mask (8th column) are 0; the 1st column has the name of the interface.
pub fn default_routes_v4(table: &str) -> Vec<String> {
    let rows = table.lines().skip(1).map(|line| line.split_whitespace().collect::<Vec<_>>());
    let is_default = |row: &Vec<&str>| row.get(1) == Some(&"00000000") && row.get(7) == Some(&"00000000");
    rows.filter(is_default).map(|row| row[0].to_owned()).collect()
}

/// The interfaces with a default route in the kernel's table `/proc/net/ipv6_route`. A route is a default route if its
/// destination (1st column) and its prefix length (2nd column) are 0; the last column has the name of the interface.
/// Routes to `lo` are left out, since the kernel rejects their packets.
pub fn default_routes_v6(table: &str) -> Vec<String> {
    let rows = table.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
    let is_default = |row: &Vec<&str>| row.len() == 10 && row[0].bytes().all(|digit| digit == b'0') && row[1] == "00";
    rows.filter(is_default).map(|row| row[9].to_owned()).filter(|name| name != "lo").collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ECAT-15.3 Default routes are found in the tables of the kernel.
    #[test]
    fn default_routes_are_found() {
        let v4 = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n\
                  eth0\t00000000\t0102A8C0\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
                  eth1\t0002A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n";
        assert_eq!(default_routes_v4(v4), ["eth0"]);
        let zero = "00000000000000000000000000000000";
        let row = |to: &str, len: &str, name: &str| {
            format!("{to} {len} {zero} 00 {zero} 00000400 00000001 00000000 00000003 {name}\n")
        };
        let v6 =
            row(zero, "00", "eth2") + &row(zero, "00", "lo") + &row("fe800000000000000000000000000000", "40", "eth3");
        assert_eq!(default_routes_v6(&v6), ["eth2"]);
    }
}
