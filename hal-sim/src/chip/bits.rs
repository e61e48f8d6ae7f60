//! Register addresses and bit positions, named as in the DW1000 User Manual chapter 7.

/// Register file identifiers.
pub(crate) mod file {
    pub(crate) const DEV_ID: u8 = 0x00;
    pub(crate) const EUI: u8 = 0x01;
    pub(crate) const PANADR: u8 = 0x03;
    pub(crate) const SYS_CFG: u8 = 0x04;
    pub(crate) const SYS_TIME: u8 = 0x06;
    pub(crate) const TX_FCTRL: u8 = 0x08;
    pub(crate) const TX_BUFFER: u8 = 0x09;
    pub(crate) const DX_TIME: u8 = 0x0A;
    pub(crate) const RX_FWTO: u8 = 0x0C;
    pub(crate) const SYS_CTRL: u8 = 0x0D;
    pub(crate) const SYS_MASK: u8 = 0x0E;
    pub(crate) const SYS_STATUS: u8 = 0x0F;
    pub(crate) const RX_FINFO: u8 = 0x10;
    pub(crate) const RX_BUFFER: u8 = 0x11;
    pub(crate) const RX_FQUAL: u8 = 0x12;
    pub(crate) const RX_TTCKI: u8 = 0x13;
    pub(crate) const RX_TTCKO: u8 = 0x14;
    pub(crate) const RX_TIME: u8 = 0x15;
    pub(crate) const TX_TIME: u8 = 0x17;
    pub(crate) const TX_ANTD: u8 = 0x18;
    pub(crate) const SYS_STATE: u8 = 0x19;
    pub(crate) const ACK_RESP_T: u8 = 0x1A;
    pub(crate) const TX_POWER: u8 = 0x1E;
    pub(crate) const CHAN_CTRL: u8 = 0x1F;
    pub(crate) const USR_SFD: u8 = 0x21;
    pub(crate) const ACC_MEM: u8 = 0x25;
    pub(crate) const DRX_CONF: u8 = 0x27;
    pub(crate) const RF_CONF: u8 = 0x28;
    pub(crate) const FS_CTRL: u8 = 0x2B;
    pub(crate) const AON: u8 = 0x2C;
    pub(crate) const OTP_IF: u8 = 0x2D;
    pub(crate) const LDE_IF: u8 = 0x2E;
    pub(crate) const DIG_DIAG: u8 = 0x2F;
    pub(crate) const PMSC: u8 = 0x36;
}

/// Offsets inside register files.
pub(crate) mod sub {
    pub(crate) const DRX_TUNE2: usize = 0x08;
    pub(crate) const DRX_SFDTOC: usize = 0x20;
    pub(crate) const DRX_PRETOC: usize = 0x24;
    pub(crate) const DRX_CAR_INT: usize = 0x28;
    pub(crate) const RXPACC_NOSAT: usize = 0x2C;
    pub(crate) const RF_STATUS: usize = 0x2C;
    pub(crate) const LDOTUNE: usize = 0x30;
    pub(crate) const FS_XTALT: usize = 0x0E;
    pub(crate) const AON_WCFG: usize = 0x00;
    pub(crate) const AON_CTRL: usize = 0x02;
    pub(crate) const AON_CFG0: usize = 0x06;
    pub(crate) const AON_CFG1: usize = 0x0A;
    pub(crate) const OTP_ADDR: usize = 0x04;
    pub(crate) const OTP_CTRL: usize = 0x06;
    pub(crate) const OTP_RDAT: usize = 0x0A;
    pub(crate) const LDE_PPINDX: usize = 0x1000;
    pub(crate) const LDE_PPAMPL: usize = 0x1002;
    pub(crate) const LDE_RXANTD: usize = 0x1804;
    pub(crate) const PMSC_CTRL0: usize = 0x00;
    pub(crate) const PMSC_CTRL1: usize = 0x04;
}

/// SYS_CFG, 7.2.6.
pub(crate) mod sys_cfg {
    pub(crate) const FFEN: u32 = 1 << 0;
    pub(crate) const FFBC: u32 = 1 << 1;
    pub(crate) const FFAB: u32 = 1 << 2;
    pub(crate) const FFAD: u32 = 1 << 3;
    pub(crate) const FFAA: u32 = 1 << 4;
    pub(crate) const FFAM: u32 = 1 << 5;
    pub(crate) const FFAR: u32 = 1 << 6;
    pub(crate) const FFA4: u32 = 1 << 7;
    pub(crate) const FFA5: u32 = 1 << 8;
    pub(crate) const HIRQ_POL: u32 = 1 << 9;
    pub(crate) const DIS_FCE: u32 = 1 << 11;
    pub(crate) const DIS_DRXB: u32 = 1 << 12;
    pub(crate) const DIS_STXP: u32 = 1 << 18;
    pub(crate) const RXM110K: u32 = 1 << 22;
    pub(crate) const RXWTOE: u32 = 1 << 28;
    pub(crate) const RXAUTR: u32 = 1 << 29;
}

/// SYS_CTRL, 7.2.15.
pub(crate) mod sys_ctrl {
    pub(crate) const SFCST: u32 = 1 << 0;
    pub(crate) const TXSTRT: u32 = 1 << 1;
    pub(crate) const TXDLYS: u32 = 1 << 2;
    pub(crate) const CANSFCS: u32 = 1 << 3;
    pub(crate) const TRXOFF: u32 = 1 << 6;
    pub(crate) const WAIT4RESP: u32 = 1 << 7;
    pub(crate) const RXENAB: u32 = 1 << 8;
    pub(crate) const RXDLYE: u32 = 1 << 9;
    pub(crate) const HRBPT: u32 = 1 << 24;
}

/// SYS_STATUS, 7.2.17.
pub(crate) mod status {
    pub(crate) const IRQS: u64 = 1 << 0;
    pub(crate) const CPLOCK: u64 = 1 << 1;
    pub(crate) const TXFRB: u64 = 1 << 4;
    pub(crate) const TXPRS: u64 = 1 << 5;
    pub(crate) const TXPHS: u64 = 1 << 6;
    pub(crate) const TXFRS: u64 = 1 << 7;
    pub(crate) const RXPRD: u64 = 1 << 8;
    pub(crate) const RXSFDD: u64 = 1 << 9;
    pub(crate) const LDEDONE: u64 = 1 << 10;
    pub(crate) const RXPHD: u64 = 1 << 11;
    pub(crate) const RXPHE: u64 = 1 << 12;
    pub(crate) const RXDFR: u64 = 1 << 13;
    pub(crate) const RXFCG: u64 = 1 << 14;
    pub(crate) const RXFCE: u64 = 1 << 15;
    pub(crate) const RXRFSL: u64 = 1 << 16;
    pub(crate) const RXRFTO: u64 = 1 << 17;
    pub(crate) const RXOVRR: u64 = 1 << 20;
    pub(crate) const RXPTO: u64 = 1 << 21;
    pub(crate) const SLP2INIT: u64 = 1 << 23;
    pub(crate) const RXSFDTO: u64 = 1 << 26;
    pub(crate) const HPDWARN: u64 = 1 << 27;
    pub(crate) const AFFREJ: u64 = 1 << 29;
    pub(crate) const HSRBP: u64 = 1 << 30;
    pub(crate) const ICRBP: u64 = 1 << 31;
    pub(crate) const TXPUTE: u64 = 1 << 34;

    /// Bits that writing 1 does not clear: they show a state and end with it.
    pub(crate) const READ_ONLY: u64 = IRQS | RXOVRR | HPDWARN | HSRBP | ICRBP | TXPUTE;
}

/// PMSC_CTRL0 and PMSC_CTRL1, 7.2.50.
pub(crate) mod pmsc {
    pub(crate) const SYSCLKS: u32 = 0b11;
    pub(crate) const SYSCLKS_XTI: u32 = 0b01;
    /// The clocks that loading the LDE microcode needs (2.5.5.10).
    pub(crate) const LDE_LOAD_CLOCKS: u32 = 0x0301;
    pub(crate) const SOFTRESET_SHIFT: u32 = 28;
    pub(crate) const SOFTRESET_NONE: u32 = 0xF;
    pub(crate) const SOFTRESET_RX: u32 = 0xE;
    pub(crate) const LDERUNE: u32 = 1 << 17;
}

/// AON_WCFG, AON_CTRL, AON_CFG0 and AON_CFG1, 7.2.45.
pub(crate) mod aon {
    pub(crate) const ONW_LEUI: u16 = 1 << 3;
    pub(crate) const ONW_LDC: u16 = 1 << 6;
    pub(crate) const ONW_LLDE: u16 = 1 << 11;
    pub(crate) const ONW_LLDO: u16 = 1 << 12;
    pub(crate) const RESTORE: u8 = 1 << 0;
    pub(crate) const SAVE: u8 = 1 << 1;
    pub(crate) const UPL_CFG: u8 = 1 << 2;
    pub(crate) const SLEEP_EN: u32 = 1 << 0;
    pub(crate) const WAKE_SPI: u32 = 1 << 2;
    pub(crate) const WAKE_CNT: u32 = 1 << 3;
    pub(crate) const SLEEP_CEN: u16 = 1 << 0;
    pub(crate) const SMXX: u16 = 1 << 1;
}

/// OTP_CTRL, 7.2.46.
pub(crate) mod otp_ctrl {
    pub(crate) const OTPRDEN: u16 = 1 << 0;
    pub(crate) const OTPREAD: u16 = 1 << 1;
    pub(crate) const LDELOAD: u16 = 1 << 15;
}
